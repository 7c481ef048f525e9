import type { LiveSample, LiveValue } from './live_recording';

export interface RunState {
  phase: 'running' | 'paused' | 'ended';
  tick: number;
  time_s: number;
  changes: number;
}

/// What a gateway answers to GET /run.
export interface RunFacts extends RunState {
  scenario: string;
  start_s: number;
  stop_s: number;
  tick_s: number;
  ticks: number;
  clock: string;
  can_pause: boolean;
  /// Whether GET /run/page has what is shown of the run.
  has_page: boolean;
  why_not?: string;
  commands: boolean;
  /// What the one who asks may do now: read, jobs, tune, acknowledge, end.
  may: string[];
}

/// A variable, as in the answer to GET /run/signals.
export interface LiveSignal {
  name: string;
  component: string;
  type: 'Real' | 'Integer' | 'Boolean' | 'String';
  size: number;
  causality: 'input' | 'output' | 'parameter' | 'local';
  settable: boolean;
  watchable: boolean;
  unit?: string;
  units?: string[];
  joints?: string[];
  description?: string;
  min?: number;
  max?: number;
  start?: LiveValue;
}

/// What the gateway answered to a change: the first tick that begins with it.
export interface Accepted {
  tick: number;
  time_s: number;
  phase: RunState['phase'];
}

/// A request that the gateway refused, with its reason.
export class Refused extends Error {
  constructor(
    readonly status: number,
    detail: string,
  ) {
    super(detail);
  }
}

export type Link = 'connecting' | 'open' | 'lost' | 'ended';

const kRate = 60; // Hz
const kFirstWait = 250; // ms, doubled by each failure
const kLongestWait = 5000;

/// The gateway that this page came from: requests, and a stream of samples that is opened again when it is lost.
export class Connection {
  link: Link = 'connecting';
  state: RunState | undefined;
  on_sample: (sample: LiveSample) => void = () => {};
  on_change: () => void = () => {};
  /// Another run answers at this address, or the token is not valid any more.
  on_other_run: () => void = () => {};
  private token = sessionStorage.getItem('cotwin-token') ?? '';
  private names: string[] = [];
  private socket: WebSocket | undefined;
  private opening = 0;
  private wait = kFirstWait;

  get has_token(): boolean {
    return this.token !== '';
  }
  /// Sends a token with all requests from now on, until the tab is closed.
  use_token(token: string): void {
    this.token = token;
    sessionStorage.setItem('cotwin-token', token);
  }

  /// Throws Refused for a status of 400 and above.
  async ask<T>(method: 'GET' | 'PUT' | 'POST', path: string, body?: unknown): Promise<T> {
    const headers: Record<string, string> = {};
    if (this.token !== '') headers['Authorization'] = `Bearer ${this.token}`;
    if (body !== undefined) headers['Content-Type'] = 'application/json';
    const reply = await fetch(path, { method, headers, ...(body === undefined ? {} : { body: JSON.stringify(body) }) });
    const content: unknown = await reply.json().catch(() => undefined);
    if (reply.ok) return content as T;
    const detail = (content as { detail?: unknown } | undefined)?.detail;
    throw new Refused(reply.status, typeof detail === 'string' ? detail : reply.statusText);
  }
  set(name: string, value: LiveValue, time_s?: number): Promise<Accepted> {
    return this.ask('PUT', `run/tunables/${encodeURIComponent(name)}`, time_s === undefined ? { value } : { value, time_s });
  }
  command(command: object): Promise<Accepted> {
    return this.ask('POST', 'run/commands', command);
  }

  /// Asks for these signals from now on. The old stream goes on until the new one has a sample.
  order(names: string[]): void {
    this.names = names;
    const opening = ++this.opening;
    // Several signals that are wanted at the same time get one stream.
    setTimeout(() => {
      if (opening === this.opening) void this.open(opening);
    }, 0);
  }

  private async open(opening: number): Promise<void> {
    if (this.names.length === 0 || this.link === 'ended') return;
    const url = new URL('run/stream', document.baseURI);
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    let query = `names=${this.names.map(encodeURIComponent).join(',')}&rate_hz=${kRate}`;
    try {
      if (this.token !== '') query += `&ticket=${encodeURIComponent((await this.ask<{ ticket: string }>('POST', 'tickets')).ticket)}`;
    } catch (error) {
      // The token is not valid any more.
      if (error instanceof Refused && error.status === 401) return this.on_other_run();
      return this.again(opening);
    }
    if (opening !== this.opening) return;
    const socket = new WebSocket(`${url.href}?${query}`);
    socket.onmessage = (event) => {
      if (opening !== this.opening && socket !== this.socket) return socket.close();
      this.take(socket, JSON.parse(String(event.data)) as { event: string; data: unknown });
    };
    socket.onclose = () => {
      if (this.socket === socket) this.socket = undefined;
      if (opening === this.opening) this.again(opening);
    };
  }

  private take(socket: WebSocket, { event, data }: { event: string; data: unknown }): void {
    if (event === 'run') {
      const before = this.state;
      this.state = data as RunState;
      if (before !== undefined && this.state.tick < before.tick) return this.on_other_run();
      this.change(this.state.phase === 'ended' ? 'ended' : 'open');
    } else if (event === 'sample') {
      if (this.socket !== socket) {
        this.socket?.close();
        this.socket = socket;
        this.wait = kFirstWait;
      }
      this.on_sample(data as LiveSample);
    }
  }

  private again(opening: number): void {
    if (this.link === 'ended' || opening !== this.opening) return;
    this.change('lost');
    setTimeout(() => {
      if (opening === this.opening) void this.open(++this.opening);
    }, this.wait);
    this.wait = Math.min(2 * this.wait, kLongestWait);
  }

  private change(link: Link): void {
    this.link = link;
    this.on_change();
  }
}
