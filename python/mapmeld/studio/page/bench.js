// Speaks to the workbench: asks for things, and hears news.

const base = new URL('.', window.location.href);

/** The name of this tab; a reload is the same tab, a copy is another one. */
function tabName() {
  const isReload = performance.getEntriesByType('navigation')[0]?.type === 'reload';
  const kept = sessionStorage.getItem('tab');
  const name = isReload && kept ? kept : crypto.randomUUID();
  sessionStorage.setItem('tab', name);
  return name;
}

export class Bench {
  constructor() {
    this.tab = tabName();
    this.onState = () => {};
    this.onElsewhere = () => {};
    this.onGone = () => {};
  }

  url(path) {
    return new URL(path, base);
  }

  async get(path) {
    const reply = await fetch(this.url(path));
    if (!reply.ok) throw new Error(await reply.text());
    return reply.json();
  }

  listen() {
    const source = new EventSource(this.url(`events?tab=${encodeURIComponent(this.tab)}`));
    source.addEventListener('open', () => this.onGone(false));
    source.addEventListener('error', () => this.onGone(true));
    source.addEventListener('state', e => this.onState(JSON.parse(e.data)));
    source.addEventListener('elsewhere', () => this.onElsewhere());
    source.addEventListener('taken', () => this.onElsewhere());
  }

  async post(path, body) {
    let reply;
    try {
      reply = await fetch(this.url(path), {
        method: 'POST',
        headers: { 'Content-Type': 'application/json' },
        body: JSON.stringify({ tab: this.tab, ...body }),
      });
    } catch {
      this.onGone(true);
      throw new Error('the workbench does not answer');
    }
    const answer = (reply.headers.get('content-type') ?? '').includes('json') ? await reply.json() : { error: await reply.text() };
    if (answer.state) this.onState(answer.state);
    if (answer.elsewhere) this.onElsewhere();
    if (!reply.ok) throw new Error(answer.error);
    return answer;
  }

  /** Does something; answers what was told of it. */
  async act(name, body = {}) {
    return (await this.post('act', { do: name, ...body })).told;
  }

  async take() {
    this.onState(await this.post('take', {}));
  }
}
