// What lies above the maps: the outline and handle of the selected one, names, pins, clicked corners, a scale.

import { apply } from './poses.js';

/** Where the round handle of a map is, screen coordinates. */
export function handleOf(app) {
  if (!app.selected || app.corners) return null;
  const points = app.cornersOf(app.selected).map(p => app.scene.toScreen(p));
  const top = points.toSorted((p, q) => p[1] - q[1]);
  const middle = app.scene.toScreen(app.middle([app.selected]));
  const at = [(top[0][0] + top[1][0]) / 2, (top[0][1] + top[1][1]) / 2];
  const length = Math.hypot(at[0] - middle[0], at[1] - middle[1]) || 1;
  const far = 26 / length;
  const clamp = (v, most) => Math.min(Math.max(v, 14), most - 14);
  return [clamp(at[0] + (at[0] - middle[0]) * far, app.scene.width), clamp(at[1] + (at[1] - middle[1]) * far, app.scene.height)];
}

export function overlay(context, app) {
  const { scene } = app;
  if (!app.state) return;
  context.lineJoin = 'round';
  for (const name of app.moved()) {
    outline(context, app.cornersOf(name).map(p => scene.toScreen(p)), app.accent, name === app.selected ? 2.5 : 1);
  }
  const handle = handleOf(app);
  if (handle) {
    context.beginPath();
    context.arc(...handle, 9, 0, 7);
    context.fillStyle = app.card;
    context.fill();
    context.strokeStyle = app.accent;
    context.lineWidth = 2.5;
    context.stroke();
    label(context, '↻', handle, app.accent, app.card, 13, 'center');
  }
  const all = document.getElementById('names').checked;
  app.infos.forEach((info, k) => {
    const m = app.state.maps[k];
    const pin = m.pin === 'hard' ? '● ' : m.pin === 'soft' ? '○ ' : '';
    if (!all && !pin && info.name !== app.selected) return;
    const at = scene.toScreen(app.middle([info.name]));
    label(context, pin + info.name, at, app.css(k), app.card, 13, 'center');
  });
  for (const p of app.state.points) {
    p.points.forEach(([a, b], k) => {
      cross(context, scene.toScreen(apply(app.poses[p.a], a)), String(k + 1), app);
      cross(context, scene.toScreen(apply(app.poses[p.b], b)), String(k + 1), app);
    });
  }
  if (app.corners) {
    for (const mark of app.corners.marks(app.poses)) cross(context, scene.toScreen(mark.at), String(mark.text), app);
    if (app.corners.cross) cross(context, app.corners.cross, '', app, 14);
  }
  ruler(context, app);
}

function outline(context, points, colour, width) {
  context.beginPath();
  points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.closePath();
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

function cross(context, [x, y], text, app, size = 8) {
  for (const [colour, width] of [[app.card, 5], [app.accent, 2]]) {
    context.beginPath();
    context.moveTo(x - size, y);
    context.lineTo(x + size, y);
    context.moveTo(x, y - size);
    context.lineTo(x, y + size);
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
  }
  if (text) label(context, text, [x + 14, y - 10], app.accent, app.card, 14, 'center');
}

function label(context, text, [x, y], colour, halo, size, align) {
  context.font = `600 ${size}px system-ui, sans-serif`;
  context.textAlign = align;
  context.textBaseline = 'middle';
  context.lineWidth = 4;
  context.strokeStyle = halo;
  context.strokeText(text, x, y);
  context.fillStyle = colour;
  context.fillText(text, x, y);
}

/** A length of one, two or five times a power of ten metres. */
function ruler(context, app) {
  const { scene } = app;
  const wanted = 110 / scene.camera.scale, power = 10 ** Math.floor(Math.log10(wanted));
  const metres = [5, 2, 1].map(k => k * power).find(m => m <= wanted) ?? power;
  const length = metres * scene.camera.scale, y = scene.height - 18;
  outline(context, [[16, y - 4], [16, y], [16 + length, y], [16 + length, y - 4], [16 + length, y], [16, y]], app.ink, 1.5);
  label(context, `${metres < 1 ? metres.toPrecision(1) : metres} m`, [16 + length / 2, y - 11], app.ink, app.scene.ground, 12, 'center');
}
