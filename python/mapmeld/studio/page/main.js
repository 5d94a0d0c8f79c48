// The page: puts the bench, the scene and the panel together.

import { listenToArrangements } from './arrangements.js';
import { Bench } from './bench.js';
import { endCorners, startCorners } from './corners.js';
import { listenToKeys } from './keys.js';
import { loadMarks } from './marks.js';
import { overlay } from './overlay.js';
import { say, show, showPairs, showScore } from './panel.js';
import { lifted, Picture } from './pictures.js';
import { listenToPointer } from './pointer.js';
import { apply, compose, inverse, turned } from './poses.js';
import { boxOf, corners, Scene } from './scene.js';

const $ = id => document.getElementById(id);
const dark = matchMedia('(prefers-color-scheme: dark)');

class App {
  constructor() {
    this.bench = new Bench();
    this.scene = new Scene($('bench'), $('over'));
    this.state = null;
    this.selected = null;
    this.whole = false;
    this.corners = null;
    this.poses = {};
    this.opacities = {};
    this.moving = null;     // poses that are being changed here and were not sent yet
    this.infos = [];
    this.marksOf = null;
    this.preview = null;    // the hypothesis that is pointed at
  }

  async start() {
    const { maps } = await this.bench.get('maps');
    this.infos = maps;
    this.pictures = Object.fromEntries(maps.map(info => [info.name, new Picture(info)]));
    await Promise.all(maps.map((info, k) => this.pictures[info.name].load(this.bench.url(`map/${k}.png`))));
    this.colour();
    this.scene.resize();
    this.scene.paintOver = context => overlay(context, this);
    this.bench.onState = state => this.hear(state);
    this.bench.onElsewhere = () => $('elsewhere').open || $('elsewhere').showModal();
    this.bench.onGone = isGone => { $('gone').hidden = !isGone; };
    this.hear(await this.bench.get('state'));
    this.fit();
    await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
    document.body.dataset.ready = 'true';
    performance.mark('first picture');
    this.bench.listen();
    if (!this.state.is_solved && !this.state.solving && !this.state.problem) this.act('solve');
  }

  colour() {
    const style = getComputedStyle(document.documentElement);
    const parse = name => style.getPropertyValue(name).trim().match(/[0-9a-f]{2}/gi).map(h => parseInt(h, 16));
    const floor = parse('--floor');
    this.scene.ground = style.getPropertyValue('--ground').trim();
    this.accent = style.getPropertyValue('--accent').trim();
    this.ink = style.getPropertyValue('--ink').trim();
    this.card = style.getPropertyValue('--card').trim();
    this.infos.forEach((info, k) => this.pictures[info.name].colour(floor, this.rgb(k)));
    this.scene.stale();
  }

  /** A map's colour; on a dark ground lighter. */
  rgb(k) {
    const colour = this.infos[k].colour;
    return dark.matches ? lifted(colour) : colour;
  }

  css(k) {
    return `rgb(${this.rgb(k).join(' ')})`;
  }

  hear(state) {
    // An answer that was overtaken by news.
    if (this.state && state.look < this.state.look) return;
    const wasSolved = this.state?.is_solved, before = this.state;
    this.state = state;
    this.preview = null;
    if (!this.moving) this.poses = Object.fromEntries(state.maps.map(m => [m.name, m.pose]));
    this.follow(before);
    this.arrange();
    show(this);
    const isNew = !before || JSON.stringify([before.maps, before.forbidden]) !== JSON.stringify([state.maps, state.forbidden]);
    if (isNew && this.selected) this.loadPairs();
    if (state.is_solved && !wasSolved && before) this.fit();
    loadMarks(this);
  }

  /** Keeps what is seen in place where a first pin gave the bench another frame. */
  follow(before) {
    if (!before || before.frame === this.state.frame) return;
    const name = this.selected ?? this.infos[0].name;
    const middle = state => this.middle([name], Object.fromEntries(state.maps.map(m => [m.name, m.pose])));
    const was = middle(before), is = middle(this.state);
    this.scene.camera = { ...this.scene.camera, x: this.scene.camera.x + is[0] - was[0], y: this.scene.camera.y + is[1] - was[1] };
  }

  /** Asks the bench; what goes wrong is told. */
  async act(name, body = {}) {
    await this.sent;
    if (name !== 'move' && name !== 'snap') showScore(null);
    try {
      const told = await this.bench.act(name, body);
      // A solve that was cancelled may be told before the answer comes.
      say(this.state.problem ?? '', 'bad');
      return told ?? true;
    } catch (error) {
      say(error.message, 'bad');
      if (name === 'move') {
        this.poses = Object.fromEntries(this.state.maps.map(m => [m.name, m.pose]));
        this.arrange();
      }
      return null;
    }
  }

  arrange() {
    const order = [...this.infos.keys()];
    // The selected map lies on top.
    order.sort((a, b) => (this.infos[a].name === this.selected) - (this.infos[b].name === this.selected));
    const all = Number($('opacity-all').value);
    this.scene.items = order.map(k => {
      const { name } = this.infos[k];
      const opacity = (this.opacities[name] ?? all) * (this.preview?.apart.includes(name) ? 0.2 : 1);
      return { name, picture: this.pictures[name], pose: this.preview?.poses[name] ?? this.poses[name], opacity };
    });
    this.scene.stale();
  }

  async loadPairs() {
    const name = this.selected;
    try {
      const pairs = await this.bench.get(`pairs?map=${encodeURIComponent(name)}`);
      if (name === this.selected) showPairs(this, pairs);
    } catch (error) {
      say(error.message, 'bad');
    }
  }

  select(name, isListed = false) {
    this.flush();
    if (this.corners && this.corners.moving !== name) endCorners(this);
    this.selected = name;
    showScore(null);
    this.arrange();
    show(this);
    if (!name) return;
    $('opacity').value = this.opacities[name] ?? $('opacity-all').value;
    this.loadPairs();
    if (isListed && !this.isInView(name)) this.fit([name]);
  }

  step(by) {
    const names = this.infos.map(i => i.name);
    const at = names.indexOf(this.selected);
    this.select(names[(at + by + names.length + (at < 0 && by < 0 ? 1 : 0)) % names.length], true);
  }

  /** Names of the maps that move together. */
  moved() {
    if (!this.selected) return [];
    const own = this.state.maps.find(m => m.name === this.selected);
    if (!this.whole || own.component === null) return [this.selected];
    return this.state.maps.filter(m => m.component === own.component).map(m => m.name);
  }

  /** Changes the poses of the maps that move together, here; `flush` sends them. */
  change(f) {
    if (this.state.solving) {
      say('A solve is running; wait for it or cancel it.', 'bad');
      return;
    }
    for (const name of this.moved()) {
      this.poses[name] = f(this.poses[name]);
      (this.moving ??= new Set()).add(name);
    }
    for (const item of this.scene.items) item.pose = this.poses[item.name];
    if (!this.scene.active.size) {
      this.scene.active = new Set(this.moving);
      this.scene.marks = [];
      this.marksOf = null;
      this.scene.stale();
    }
    this.scene.ask();
  }

  shift(dx, dy) {
    this.change(([x, y, t]) => [x + dx, y + dy, t]);
  }

  turn(angle) {
    if (!this.selected) return;
    const about = this.middle(this.moved());
    this.change(t => turned(t, about, angle));
  }

  /** Sends what was moved once nothing has moved for a while. */
  flushSoon() {
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => this.flush(), 400);
  }

  flush() {
    clearTimeout(this.waiting);
    const names = this.moving;
    this.moving = null;
    this.scene.active = new Set();
    if (!names) return this.sent;
    const poses = Object.fromEntries([...names].map(n => [n, this.poses[n]]));
    this.scene.stale();
    showScore(null);
    const sent = this.act('move', { poses });
    this.sent = sent.then(() => { this.sent = null; });
    return this.sent;
  }

  async snap() {
    if (!this.selected) return say('Select a map first.', 'bad');
    await this.flush();
    const found = await this.act('snap', { names: this.moved() });
    if (!found) return;
    const onto = found.onto ? ` onto ${found.onto}` : '';
    showScore(`Snapped${onto}: probability ${found.probability.toFixed(2)}, ${found.shared_length.toFixed(1)} m of wall in ` +
      `common, ${(100 * found.agreement).toFixed(0)} % of it agrees. Right? Pin it, then solve again.`);
  }

  async pin(isSoft) {
    if (!this.selected) return say('Select a map first.', 'bad');
    await this.flush();
    const name = this.selected, now = this.state.maps.find(m => m.name === name).pin;
    if (now === (isSoft ? 'soft' : 'hard')) return this.act('unpin', { name });
    const also = await this.act('pin', { name, soft: isSoft });
    if (typeof also === 'string') say(`${also} is pinned as well: a pin tells where a map lies to other pins.`, 'good');
  }

  async unpin() {
    if (this.state.maps.find(m => m.name === this.selected)?.pin) await this.act('unpin', { name: this.selected });
  }

  async solve() {
    await this.flush();
    await this.act('solve');
  }

  async save() {
    await this.flush();
    const files = await this.act('save');
    if (Array.isArray(files)) say(`Saved in ${this.state.output}: ${files.join(', ')}`, 'good');
  }

  /** Names of the maps that show something at a point of the bench, the uppermost first. */
  mapsAt(world, wanted = () => true) {
    const reach = 4 / this.scene.camera.scale;
    return this.scene.items.toReversed().filter(({ name, picture, pose }) => {
      const point = apply(inverse(compose(pose, picture.info.origin)), world);
      return wanted(name) && picture.isKnownAt(point, reach);
    }).map(item => item.name);
  }

  cornersOf(name, poses = this.poses) {
    return corners(this.pictures[name].info, poses[name]);
  }

  middle(names, poses = this.poses) {
    const [l, b, r, t] = boxOf(names.flatMap(n => this.cornersOf(n, poses)));
    return [(l + r) / 2, (b + t) / 2];
  }

  fit(names = this.infos.map(i => i.name)) {
    this.scene.fit(boxOf(names.flatMap(n => this.cornersOf(n))));
  }

  isInView(name) {
    const [x, y] = this.scene.toScreen(this.middle([name]));
    return x > 0 && y > 0 && x < this.scene.width && y < this.scene.height;
  }
}

const app = new App();
window.app = app;

for (const [id, f] of Object.entries({
  solve: () => app.solve(), cancel: () => app.act('cancel'), undo: () => app.act('undo'),
  redo: () => app.act('redo'), save: () => app.save(), snap: () => app.snap(), pin: () => app.pin(false),
  soft: () => app.pin(true), corners: () => (app.corners ? endCorners(app) : startCorners(app)), fit: () => app.fit(),
  keys: () => $('help').showModal(), 'use-here': () => { $('elsewhere').close(); app.bench.take(); },
})) $(id).addEventListener('click', f);
$('whole').addEventListener('change', e => { app.whole = e.target.checked; app.scene.ask(); });
$('names').addEventListener('change', () => app.scene.ask());
$('conflicts').addEventListener('change', () => loadMarks(app));
$('opacity').addEventListener('input', e => { app.opacities[app.selected] = Number(e.target.value); app.arrange(); });
$('opacity-all').addEventListener('input', e => { app.opacities = {}; $('opacity').value = e.target.value; app.arrange(); });
$('elsewhere').addEventListener('cancel', e => e.preventDefault());
dark.addEventListener('change', () => { app.colour(); if (app.state) show(app); });
new ResizeObserver(() => app.scene.resize()).observe($('bench'));
listenToPointer(app);
listenToKeys(app);
listenToArrangements(app);
app.start().catch(error => say(error.message, 'bad'));
