// The keyboard: what is done most has a key, listed under "?"; the rest are buttons that Tab comes to.

import { clickCorner, endCorners, sendCorners, startCorners } from './corners.js';

const $ = id => document.getElementById(id);
const TURN = Math.PI / 180;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export function listenToKeys(app) {
  window.addEventListener('keydown', e => {
    if (!app.state || document.querySelector('dialog[open]')) return;
    if (e.ctrlKey || e.metaKey) {
      const f = { z: () => app.act(e.shiftKey ? 'redo' : 'undo'), y: () => app.act('redo'), s: () => app.save() }[e.key.toLowerCase()];
      if (f) {
        e.preventDefault();
        app.flush();
        f();
      }
      return;
    }
    if (e.altKey) return;
    // A slider has arrows of its own, a button its Enter.
    const focused = document.activeElement.tagName;
    if (e.key in ARROWS && focused !== 'INPUT') {
      e.preventDefault();
      arrow(app, ARROWS[e.key], e.shiftKey);
      return;
    }
    if (e.key === 'Enter' && app.corners && focused !== 'BUTTON') {
      const { corners } = app;
      if (corners.cross) clickCorner(app, corners.cross);
      else if (corners.pairs.length && corners.open === null) sendCorners(app);
      return;
    }
    const f = KEYS[e.key.length === 1 ? e.key.toLowerCase() : e.key];
    if (!f) return;
    e.preventDefault();
    f(app, e);
  });
}

function arrow(app, [x, y], isFar) {
  const { scene, corners } = app;
  if (corners) {
    // With Shift finely, since the cross has to hit a corner.
    const by = isFar ? 1 : 10;
    const from = corners.cross ?? scene.toScreen(app.middle([corners.open ? corners.staying ?? corners.moving : corners.moving]));
    corners.cross = [from[0] + x * by, from[1] - y * by];
    scene.ask();
  } else if (app.selected) {
    const cell = app.pictures[app.selected].info.resolution * (isFar ? 10 : 1);
    app.shift(x * cell, y * cell);
    app.flushSoon();
  } else scene.pan(-60 * x, 60 * y);
}

function turn(app, sign, e) {
  if (!app.selected) return;
  app.turn(sign * TURN * (e.shiftKey ? 10 : 1));
  app.flushSoon();
}

const KEYS = {
  ',': app => app.step(-1),
  '.': app => app.step(1),
  '[': (app, e) => turn(app, 1, e),
  '{': (app, e) => turn(app, 1, e),
  ']': (app, e) => turn(app, -1, e),
  '}': (app, e) => turn(app, -1, e),
  '+': app => app.scene.zoom(1.25),
  '=': app => app.scene.zoom(1.25),
  '-': app => app.scene.zoom(0.8),
  0: app => app.fit(),
  f: app => app.selected && app.fit(app.moved()),
  s: app => app.snap(),
  k: app => (app.corners ? endCorners(app) : startCorners(app)),
  p: app => app.pin(false),
  o: app => app.pin(true),
  u: app => app.unpin(),
  v: app => app.solve(),
  w: () => $('whole').click(),
  c: () => $('conflicts').click(),
  n: () => $('names').click(),
  '?': () => $('help').showModal(),
  Escape: app => {
    if (app.corners) endCorners(app);
    else if (app.state.solving) app.act('cancel');
    else app.select(null);
  },
};
