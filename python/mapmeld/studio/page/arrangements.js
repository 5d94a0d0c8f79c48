// The list of whole arrangements that fit: what each has otherwise, in words and, while it is pointed at, in place.

import { element, replace, say } from './panel.js';

const list = document.querySelector('#hypotheses ol');

/** Shows the hypotheses. A person who points at one, or comes to it with Tab, sees its maps there. */
export function showArrangements(app) {
  const { hypotheses, solving } = app.state;
  document.getElementById('hypotheses').hidden = hypotheses.length < 2;
  replace(list, hypotheses.map((h, k) => {
    const button = element('button', { onclick: () => choose(app, k), title: 'Say that this one is true' }, 'Choose');
    button.disabled = solving !== null;
    button.setAttribute('aria-label', `Choose ${k + 1}: ${h.says}`);
    return element('li', { 'data-k': k }, element('span', {}, `${k + 1}: ${h.says}`),
      element('span', { class: 'number' }, h.probability.toFixed(2)), button);
  }));
}

async function choose(app, k) {
  await app.flush();
  preview(app, null);
  const said = await app.act('choose', { hypothesis: k });
  if (said) say(`You said: ${said}. Solve again.`, 'good');
}

export function listenToArrangements(app) {
  const of = e => e.target.closest('li')?.dataset.k;
  for (const name of ['mouseover', 'focusin']) list.addEventListener(name, e => preview(app, of(e)));
  for (const name of ['mouseleave', 'focusout']) list.addEventListener(name, () => preview(app, null));
}

function preview(app, k) {
  const h = k === undefined || k === null ? null : app.state.hypotheses[k];
  if (h === app.preview || app.moving) return;
  app.preview = h ?? null;
  app.arrange();
}
