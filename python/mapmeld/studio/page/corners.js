// Clicking the same corners in two maps: first in the map that shall move, then in the one that stays.

import { hint, say, showScore } from './panel.js';
import { apply, inverse } from './poses.js';

const NEEDED = 2;

export class Corners {
  constructor(name) {
    this.moving = name;
    this.staying = null;
    this.pairs = [];      // [point of the staying map, point of the moving map], map coordinates
    this.open = null;     // the point of the moving map that waits for its like
    this.cross = null;    // screen coordinates of the keyboard's cross
  }

  get isDone() {
    return this.pairs.length === NEEDED;
  }

  get hint() {
    const which = this.pairs.length ? 'another corner, far from the first,' : 'a corner';
    const end = this.pairs.length && this.open === null ? ' Enter: one is enough, it is turned right. ' : ' ';
    return this.open === null
      ? `Click ${which} of ${this.moving}.${end}Esc ends.`
      : `Click the same corner in ${this.staying ?? 'another map'}. Esc ends.`;
  }

  /** Takes a click at a point of the bench; `mapAt(world, wanted)` names a map there. False when no map lies there. */
  click(world, mapAt, poses) {
    const point = name => apply(inverse(poses[name]), world);
    if (this.open === null) {
      if (!mapAt(world, name => name === this.moving)) return false;
      this.open = point(this.moving);
      return true;
    }
    const other = mapAt(world, name => (this.staying ? name === this.staying : name !== this.moving));
    if (!other) return false;
    this.staying = other;
    this.pairs.push([point(other), this.open]);
    this.open = null;
    return true;
  }

  /** The clicked points on the bench, with their numbers. */
  marks(poses) {
    const marks = this.pairs.flatMap(([p, q], k) => [
      { at: apply(poses[this.staying], p), text: k + 1 },
      { at: apply(poses[this.moving], q), text: k + 1 },
    ]);
    if (this.open) marks.push({ at: apply(poses[this.moving], this.open), text: this.pairs.length + 1 });
    return marks;
  }
}


const button = document.getElementById('corners');

export function startCorners(app) {
  if (app.state.maps.length < 2) {
    say('Corners are clicked in two maps, and there is only one here.', 'bad');
    return;
  }
  if (!app.selected) {
    say('Select the map that shall move first.', 'bad');
    return;
  }
  app.flush();
  app.corners = new Corners(app.selected);
  button.setAttribute('aria-pressed', 'true');
  hint(app.corners.hint);
  app.scene.canvas.focus();
  app.scene.ask();
}

export function endCorners(app) {
  app.corners = null;
  button.setAttribute('aria-pressed', 'false');
  hint(null);
  app.scene.ask();
}

export async function clickCorner(app, screen) {
  const c = app.corners;
  if (!c.click(app.scene.toWorld(screen), (w, wanted) => app.mapsAt(w, wanted)[0], app.poses)) {
    say(c.open === null ? `${c.moving} does not lie there.` : `${c.staying ?? 'No other map'} does not lie there.`, 'bad');
    return;
  }
  say('');
  if (c.isDone) await sendCorners(app);
  else hint(c.hint);
  app.scene.ask();
}

export async function sendCorners(app) {
  const { moving, staying, pairs } = app.corners;
  if (!pairs.length) return;
  endCorners(app);
  const ok = await app.act('points', { a: staying, b: moving, points: pairs });
  if (ok) showScore(`${moving} lies where the corners meet ${staying}. Now Snap settles it.`);
  if (ok && !app.isInView(moving)) app.fit([moving, staying]);
}
