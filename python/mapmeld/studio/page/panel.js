// The side panel: lists, numbers and buttons.

import { showArrangements } from './arrangements.js';

const $ = id => document.getElementById(id);
const APART = new Set(['no evidence', 'ambiguous', 'prior', 'blank']);
const STAGES = {
  prepare: 'maps prepared', register: 'pairs registered', filter: 'maps placed', join: 'parts joined', fuse: 'maps fused',
};

export function element(tag, attributes = {}, ...children) {
  const e = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === 'onclick') e.addEventListener('click', value);
    else if (key === 'colour') e.style.background = value;
    else e.setAttribute(key, value);
  }
  e.append(...children);
  return e;
}

export function say(text, kind = '') {
  $('message').textContent = text ?? '';
  $('message').className = kind;
}

export function hint(text) {
  $('hint').textContent = text ?? '';
  $('hint').hidden = !text;
}

/** Shows the state. `app` has: state, infos, selected, select(name), act(name, body). */
export function show(app) {
  const { state } = app;
  const busy = state.solving !== null;
  $('solve').disabled = busy;
  $('solve').textContent = state.is_solved ? 'Solve again' : 'Solve';
  $('solve').classList.toggle('main', !state.is_current);
  $('undo').disabled = busy || state.undo === null;
  $('undo').title = state.undo === null ? 'Nothing to undo' : `Undo: ${state.undo} (Ctrl+Z)`;
  $('redo').disabled = busy || state.redo === null;
  $('redo').title = state.redo === null ? 'Nothing to redo' : `Redo: ${state.redo} (Ctrl+Shift+Z)`;
  $('save').disabled = busy || !state.is_solved;
  $('save').classList.toggle('main', state.is_current && !state.is_saved);
  $('progress').hidden = !busy;
  if (busy) {
    const { stage, done, total } = state.solving;
    $('progress').querySelector('progress').value = total ? done / total : 0;
    $('progress').querySelector('span').textContent = total ? `${STAGES[stage] ?? stage}: ${done} of ${total}` : 'starting';
  }
  $('verdict').textContent = verdict(state);
  if (state.problem) say(state.problem, 'bad');
  showMaps(app);
  showKnown(app);
  showArrangements(app);
  showSelected(app);
}

function verdict(state) {
  if (!state.is_solved) return state.solving ? '' : 'Not solved yet: the maps lie side by side.';
  const parts = state.parts.filter(p => p.maps.length);
  const apart = state.maps.filter(m => APART.has(m.status));
  const text = [lie(state.maps, parts.length, apart.length)];
  if (apart.length && parts.length > 1) text.push(`Not placed: ${apart.map(m => m.name).join(', ')}.`);
  const first = state.parts[0];
  if (first?.shared_cells) text.push(`${(100 * first.conflict_cells / first.shared_cells).toFixed(1)} % of the cells that several maps know contradict (C marks them).`);
  if (state.is_current && state.moved.length) {
    const names = state.moved.length > 5 ? `${state.moved.length} maps` : state.moved.join(', ');
    text.push(`Moved since the solve, which Save does not write: ${names}.`);
  }
  if (!state.is_current) text.push('What you said since then is not in it: solve again.');
  return text.join(' ');
}

/** How the maps lie, in a sentence. */
function lie(maps, parts, apart) {
  if (maps.length === 1) return 'There is one map.';
  const all = maps.length === 2 ? 'Both maps' : `All ${maps.length} maps`;
  if (maps.every(m => m.status === 'pinned')) return `${all} lie where they are pinned.`;
  if (parts === 1 && !apart) return `${all} lie together.`;
  return `${maps.length} maps, ${parts === 1 ? 'one part' : `${parts} parts`}.`;
}

function showMaps(app) {
  $('legend').hidden = !app.state.maps.some(m => m.contradicting !== null);
  const rows = app.state.maps.map((m, k) => {
    const pin = m.pin === 'hard' ? '● ' : m.pin === 'soft' ? '○ ' : '';
    const probability = m.status === 'merged' ? ` ${m.probability.toFixed(2)}` : '';
    const against = m.contradicting === null ? '' : `, ✗ ${(100 * m.contradicting).toFixed(0)} %`;
    const status = element('span', { class: APART.has(m.status) ? 'status apart' : 'status' }, m.status ? pin + m.status + probability + against : pin);
    const swatch = element('i', { colour: app.css(k), 'aria-hidden': 'true' });
    return element('li', {}, element('button', {
      'aria-pressed': String(app.selected === m.name), title: m.reason ?? m.name, onclick: () => app.select(m.name, true),
    }, swatch, element('span', { class: 'name' }, m.name), status));
  });
  replace($('maps'), rows);
}

function showKnown(app) {
  const { state } = app;
  const items = [];
  const item = (text, undo, title) => items.push(element('li', {}, element('span', {}, text), element('button', { onclick: undo, title }, 'Remove')));
  for (const m of state.maps) {
    if (m.pin) item(`${m.name} lies ${m.pin === 'hard' ? 'exactly' : 'about'} here`, () => app.act('unpin', { name: m.name }), `Let ${m.name} go`);
  }
  for (const p of state.points) {
    item(`${p.points.length} point${p.points.length > 1 ? 's' : ''} of ${p.a} and ${p.b}`, () => app.act('forget_points', { a: p.a, b: p.b }), 'Forget these points');
  }
  for (const [a, b] of state.forbidden) item(`${a} and ${b} do not match`, () => app.act('allow', { a, b }), 'Allow them to match');
  $('known').hidden = !items.length;
  replace($('known').querySelector('ul'), items);
}

function showSelected(app) {
  const m = app.state.maps.find(x => x.name === app.selected);
  $('selected').hidden = !m;
  if (!m) return;
  $('selected').querySelector('h2').textContent = m.name;
  $('selected').querySelector('.reason').textContent = m.reason ? `${m.status}: ${m.reason}`.replace('pinned: ', '') : 'not solved yet';
  if (m.contradicting !== null) {
    $('selected').querySelector('.reason').textContent += `. ${(100 * m.contradicting).toFixed(1)} % of its cells contradict other maps`;
  }
  $('pin').textContent = m.pin === 'hard' ? 'Let go' : 'Pin';
  $('pin').setAttribute('aria-pressed', String(m.pin === 'hard'));
  $('soft').textContent = m.pin === 'soft' ? 'Let go' : 'Soft pin';
  $('soft').setAttribute('aria-pressed', String(m.pin === 'soft'));
  for (const id of ['snap', 'corners', 'pin', 'soft']) $(id).disabled = app.state.solving !== null;
  $('corners').title = app.state.maps.length < 2 ? 'Needs a second map' : 'Click the same two corners in two maps (K)';
}

/** What the pairs of the selected map say. */
export function showPairs(app, pairs) {
  replace($('pairs').tBodies[0], pairs.map(p => {
    const other = p.a === app.selected ? p.b : p.a;
    const is = p.status === 'forbidden';
    const button = element('button', {
      onclick: () => app.act(is ? 'allow' : 'forbid', { a: p.a, b: p.b }),
      title: is ? 'Let them match again' : 'These two do not belong together',
    }, is ? 'Allow' : 'Forbid');
    return element('tr', {}, element('td', {}, other), element('td', {}, p.status ?? '–'),
      element('td', { class: 'number' }, p.probability === null ? '–' : p.probability.toFixed(2)), element('td', {}, button));
  }));
}

export function showScore(text) {
  $('score').hidden = !text;
  $('score').textContent = text ?? '';
}

/** Puts new children in; the focus stays at the same place of the list. */
export function replace(parent, children) {
  const at = [...parent.querySelectorAll('button')].indexOf(document.activeElement);
  parent.replaceChildren(...children);
  if (at >= 0) (parent.querySelectorAll('button')[at] ?? parent.closest('section')?.querySelector('button'))?.focus();
}
