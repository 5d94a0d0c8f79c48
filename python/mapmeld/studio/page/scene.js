// Draws the bench: pictures in their places under a camera. What does not change while the view moves is drawn once
// into a layer that is larger than the view, so that moving the view costs one copy.

import { apply, compose } from './poses.js';
import { surface } from './pictures.js';

const MARGIN = 0.3;

export class Scene {
  constructor(canvas, over) {
    this.canvas = canvas;
    this.over = over;
    this.camera = { x: 0, y: 0, scale: 20 };
    this.items = [];     // {name, picture, pose, opacity}, the lowest first
    this.marks = [];     // {canvas, pose, resolution, height}: where maps contradict each other
    this.active = new Set();  // names of maps that are being moved: drawn above the layer
    this.paintOver = () => {};
    this.layer = surface(1, 1);
    this.layerCamera = null;
    this.frames = 0;
    this.asked = false;
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const box = this.canvas.getBoundingClientRect();
    this.ratio = ratio;
    this.width = box.width;
    this.height = box.height;
    for (const c of [this.canvas, this.over]) {
      c.width = Math.round(box.width * ratio);
      c.height = Math.round(box.height * ratio);
    }
    this.stale();
  }

  /** Something in the layer has changed. */
  stale() {
    this.layerCamera = null;
    this.ask();
  }

  /** Draws at the next frame. */
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  toScreen([x, y], camera = this.camera) {
    return [(x - camera.x) * camera.scale + this.width / 2, this.height / 2 - (y - camera.y) * camera.scale];
  }

  toWorld([u, v]) {
    const { x, y, scale } = this.camera;
    return [x + (u - this.width / 2) / scale, y - (v - this.height / 2) / scale];
  }

  pan(du, dv) {
    this.camera = { ...this.camera, x: this.camera.x - du / this.camera.scale, y: this.camera.y + dv / this.camera.scale };
    this.ask();
  }

  zoom(factor, at = [this.width / 2, this.height / 2]) {
    const before = this.toWorld(at);
    this.camera = { ...this.camera, scale: Math.min(2000, Math.max(0.2, this.camera.scale * factor)) };
    const after = this.toWorld(at);
    this.camera.x += before[0] - after[0];
    this.camera.y += before[1] - after[1];
    this.ask();
    // While it is being zoomed the old layer is stretched; sharp again once it rests.
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.stale(), 80);
  }

  /** Shows a box of the bench [left, bottom, right, top]. */
  fit([left, bottom, right, top]) {
    const scale = 0.92 * Math.min(this.width / Math.max(right - left, 1), this.height / Math.max(top - bottom, 1));
    this.camera = { x: (left + right) / 2, y: (bottom + top) / 2, scale };
    this.stale();
  }

  draw() {
    const layerFits = this.layerCamera && this.covers();
    if (!layerFits) this.drawLayer();
    const { canvas, ratio } = this;
    const context = canvas.getContext('2d', { alpha: false });
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.ground;
    context.fillRect(0, 0, canvas.width, canvas.height);
    const k = this.camera.scale / this.layerCamera.scale;
    const [u, v] = this.toScreen([this.layerCamera.x, this.layerCamera.y]);
    const w = this.layer.width * k, h = this.layer.height * k;
    const x = u * ratio - w / 2, y = v * ratio - h / 2;
    context.imageSmoothingEnabled = k !== 1;
    if (k === 1) context.drawImage(this.layer, Math.round(x), Math.round(y));
    else context.drawImage(this.layer, x, y, w, h);
    this.drawItems(context, item => this.active.has(item.name), 0, 0);
    const top = this.over.getContext('2d');
    top.setTransform(ratio, 0, 0, ratio, 0, 0);
    top.clearRect(0, 0, this.width, this.height);
    this.paintOver(top);
    this.frames++;
  }

  /** Whether the layer shows all of the view, or will soon be drawn anew anyway. */
  covers() {
    if (this.layerCamera.scale !== this.camera.scale) return true;
    const du = Math.abs(this.camera.x - this.layerCamera.x) * this.camera.scale;
    const dv = Math.abs(this.camera.y - this.layerCamera.y) * this.camera.scale;
    return du <= MARGIN * this.width && dv <= MARGIN * this.height;
  }

  drawLayer() {
    const width = Math.ceil(this.canvas.width * (1 + 2 * MARGIN)), height = Math.ceil(this.canvas.height * (1 + 2 * MARGIN));
    if (this.layer.width !== width || this.layer.height !== height) this.layer = surface(width, height);
    this.layerCamera = { ...this.camera };
    const context = this.layer.getContext('2d');
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    const dx = (width - this.canvas.width) / 2, dy = (height - this.canvas.height) / 2;
    this.drawItems(context, item => !this.active.has(item.name), dx, dy);
    for (const mark of this.marks) {
      this.place(context, mark.pose, mark.resolution, mark.height * mark.resolution, this.camera, dx, dy);
      context.globalAlpha = 1;
      context.imageSmoothingEnabled = true;
      context.drawImage(mark.canvas, 0, 0);
    }
  }

  drawItems(context, isWanted, dx, dy) {
    const items = this.items.filter(isWanted);
    for (const item of items) this.drawItem(context, item, item.picture.floors, this.camera, dx, dy);
    for (const item of items) this.drawItem(context, item, item.picture.walls, this.camera, dx, dy);
  }

  drawItem(context, item, levels, camera, dx, dy) {
    const { info } = item.picture;
    if (!levels.length) return;
    const size = info.resolution * camera.scale * this.ratio;
    let level = Math.max(0, Math.floor(Math.log2(1 / size) + 0.5));
    level = Math.min(level, levels.length - 1);
    const pose = compose(item.pose, info.origin);
    this.place(context, pose, info.resolution * 2 ** level, info.height * info.resolution, camera, dx, dy);
    context.globalAlpha = item.opacity;
    context.imageSmoothingEnabled = size * 2 ** level < 1.5;
    context.imageSmoothingQuality = 'low';
    context.drawImage(levels[level], 0, 0);
    context.globalAlpha = 1;
  }

  /** The transform of a picture whose rows run down from the top, `rise` metres above its pose. */
  place(context, pose, resolution, rise, camera, dx, dy) {
    const c = Math.cos(pose[2]), s = Math.sin(pose[2]), k = camera.scale * this.ratio;
    const x = (pose[0] - s * rise - camera.x) * k + this.canvas.width / 2 + dx;
    const y = this.canvas.height / 2 + dy - (pose[1] + c * rise - camera.y) * k;
    const r = resolution * k;
    context.setTransform(c * r, -s * r, s * r, c * r, x, y);
  }
}

/** Corners of a map's known cells on the bench. */
export function corners(info, pose) {
  const T = compose(pose, info.origin), [l, b, r, t] = info.box;
  return [[l, b], [r, b], [r, t], [l, t]].map(p => apply(T, p));
}

/** The box of some points [left, bottom, right, top]. */
export function boxOf(points) {
  const xs = points.map(p => p[0]), ys = points.map(p => p[1]);
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}
