// Mouse, pen and finger on the canvas.

import { clickCorner } from './corners.js';
import { handleOf } from './overlay.js';

const STILL = 4;   // pixels that a click may move

export function listenToPointer(app) {
  const { canvas } = app.scene;
  let held = null;    // {kind, from, last}

  const at = e => {
    const box = canvas.getBoundingClientRect();
    return [e.clientX - box.left, e.clientY - box.top];
  };

  canvas.addEventListener('pointerdown', e => {
    if (!app.state || e.button > 1) return;
    canvas.setPointerCapture(e.pointerId);
    const point = at(e);
    held = { kind: kindAt(point, e.button), from: point, last: point };
  });

  function kindAt(point, button) {
    if (button === 1 || app.corners) return 'pan';
    const handle = handleOf(app);
    if (handle && Math.hypot(point[0] - handle[0], point[1] - handle[1]) < 14) return 'turn';
    const here = app.mapsAt(app.scene.toWorld(point));
    return app.selected && here.some(name => app.moved().includes(name)) ? 'move' : 'pan';
  }

  canvas.addEventListener('pointermove', e => {
    const point = at(e);
    if (!held) {
      canvas.style.cursor = app.corners ? 'crosshair' : { turn: 'grab', move: 'move', pan: 'default' }[app.state ? kindAt(point, 0) : 'pan'];
      return;
    }
    const [du, dv] = [point[0] - held.last[0], point[1] - held.last[1]];
    if (!held.moves && Math.hypot(point[0] - held.from[0], point[1] - held.from[1]) < STILL) return;
    held.moves = true;
    if (held.kind === 'move') app.shift(du / app.scene.camera.scale, -dv / app.scene.camera.scale);
    else if (held.kind === 'turn') {
      const middle = app.scene.toScreen(app.middle(app.moved()));
      const angle = p => Math.atan2(middle[1] - p[1], p[0] - middle[0]);
      app.turn(angle(point) - angle(held.last));
    } else app.scene.pan(du, dv);
    held.last = point;
  });

  canvas.addEventListener('pointerup', e => {
    if (!held) return;
    const { kind, moves, from } = held;
    held = null;
    if (moves) {
      if (kind !== 'pan') app.flush();
      return;
    }
    if (e.button !== 0) return;
    if (app.corners) {
      clickCorner(app, from);
      return;
    }
    // Again at the same place: what lies below.
    const here = app.mapsAt(app.scene.toWorld(from));
    const next = here.indexOf(app.selected) + 1;
    app.select(here[next] ?? (here.length > 1 ? here[0] : here.length ? app.selected : null));
  });

  canvas.addEventListener('pointercancel', () => {
    held = null;
    app.flush();
  });

  canvas.addEventListener('wheel', e => {
    e.preventDefault();
    const by = e.deltaY || e.deltaX;
    if (e.shiftKey && app.selected) {
      app.turn(Math.sign(-by) * Math.PI / 180);
      app.flushSoon();
    } else app.scene.zoom(Math.exp(-by * (e.deltaMode ? 0.05 : 0.0015)), at(e));
  }, { passive: false });
}
