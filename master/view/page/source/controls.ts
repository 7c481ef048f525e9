import { Refused, type Accepted, type Connection, type LiveSignal, type RunFacts } from './connection';
import { button, element, short } from './dom';
import { element_name, type PlannedEvent } from './format';
import type { LiveElement, LiveValue } from './live_recording';

const kMostShown = 40; // settable signals in the list
const kMostElements = 16; // of a signal with a slider each

/// The range of a slider: the bounds of the variable where they are near its start value, otherwise a range about that.
export function slider_range(signal: Pick<LiveSignal, 'min' | 'max' | 'type'>, start: number): { min: number; max: number } {
  const size = Number.isFinite(start) && start !== 0 ? Math.abs(start) : 0;
  const near = (bound: number | undefined): boolean => bound !== undefined && (size === 0 ? Math.abs(bound) <= 1000 : Math.abs(bound - start) <= 20 * size);
  const reach = size === 0 ? 10 : 2 * size;
  const centre = Number.isFinite(start) ? start : 0;
  const min = near(signal.min) ? signal.min! : Math.max(signal.min ?? -Infinity, centre - reach);
  const max = near(signal.max) ? signal.max! : Math.min(signal.max ?? Infinity, centre + reach);
  return signal.type === 'Integer' ? { min: Math.ceil(min), max: Math.floor(max) } : { min, max };
}

/// The signals whose name or description has all words of the text.
export function matching<T extends { name: string; description?: string }>(signals: T[], text: string): T[] {
  const words = text.toLowerCase().split(/\s+/).filter((word) => word !== '');
  return signals.filter((signal) => words.every((word) => `${signal.name} ${signal.description ?? ''}`.toLowerCase().includes(word)));
}

const elements_of = (value: LiveValue | undefined): LiveElement[] => (Array.isArray(value) ? value : value === undefined ? [] : [value]);
const number_of = (value: LiveElement | undefined): number => (typeof value === 'boolean' ? Number(value) : (value ?? NaN));

/// The controls of an element, and what shows a value in them.
interface Row {
  box: HTMLElement;
  show: (value: number) => void;
}

/// Events of the same time, in their order. Of two that give one variable a value at that time, the later one counts.
export function moments_of(events: PlannedEvent[]): PlannedEvent[][] {
  const moments = new Map<number, PlannedEvent[]>();
  for (const event of events) {
    const others = (moments.get(event.time_s) ?? []).filter(({ name }) => name !== event.name);
    moments.set(event.time_s, [...others, event]);
  }
  return [...moments.values()];
}

/// What changes a run: buttons, sliders, events.
export class Controls {
  readonly bar = element('span', { class: 'run' });
  readonly values = element('details', { class: 'panel values', open: '' }, element('summary', {}, 'Values'));
  readonly events = element('details', { class: 'panel events' }, element('summary', {}, 'Events'));
  private readonly pause = button('pause', 'pause or resume the run (p)', () => this.toggle_pause());
  private readonly step = button('step', 'make some ticks, then pause (.)', () => this.make_steps());
  private readonly ticks = element('input', { type: 'number', min: '1', step: '1', value: '10', 'aria-label': 'ticks of a step', title: 'ticks of a step' });
  private readonly stop = button('stop', 'end the run', () => this.ask_to_stop());
  private readonly note = element('span', { class: 'note', role: 'status' });
  private readonly list = element('div', {});
  private readonly filter = element('input', { type: 'search', placeholder: 'filter', 'aria-label': 'filter the values' });
  private readonly settable: LiveSignal[];
  private readonly opened = new Set<string>();
  private asked = 0;

  constructor(
    private readonly connection: Connection,
    private readonly facts: RunFacts,
    signals: LiveSignal[],
    events: PlannedEvent[],
  ) {
    const rank = (signal: LiveSignal): number => (signal.causality === 'input' ? 0 : 1);
    const may = new Set(facts.may);
    const may_set = (signal: LiveSignal): boolean => may.has(signal.name.endsWith('.acknowledge') ? 'acknowledge' : 'tune');
    this.settable = signals.filter((signal) => signal.settable && signal.watchable && (may_set(signal) || !facts.commands)).sort((a, b) => rank(a) - rank(b));
    this.bar.append(this.pause, this.step, this.ticks, this.stop, this.note);
    for (const control of [this.pause, this.step, this.ticks]) control.disabled = control.hidden = facts.commands && !may.has('tune');
    this.stop.hidden = facts.commands && !may.has('end');
    this.events.hidden = facts.commands && !may.has('tune');
    if (!facts.commands) this.make_read_only('the gateway takes no commands (parameter commands)');
    else if (!['tune', 'acknowledge', 'end'].some((scope) => may.has(scope))) this.make_read_only(connection.has_token ? 'this token may only watch' : 'only its user may change it (--local-writes)');
    else if (!facts.can_pause && may.has('tune')) {
      for (const control of [this.pause, this.step, this.ticks]) control.disabled = true;
      this.say(`no pause: ${facts.why_not ?? ''}`);
    }
    this.filter.addEventListener('input', () => this.fill());
    this.values.append(this.filter, this.list);
    this.fill();
    for (const together of moments_of(events)) this.events.append(this.event_entry(together));
    if (events.length === 0) this.events.append(element('div', { class: 'lacks' }, 'the scenario plans no events'));
    this.update();
  }

  /// Shows the phase of the run.
  update(): void {
    const phase = this.connection.state?.phase ?? this.facts.phase;
    this.pause.textContent = phase === 'paused' ? 'resume' : 'pause';
    this.pause.setAttribute('aria-pressed', String(phase === 'paused'));
    if (phase === 'ended' || this.connection.link === 'ended') this.make_read_only('the run has ended');
  }

  toggle_pause(): void {
    if (this.pause.disabled) return;
    void this.send(() => this.connection.command({ command: this.connection.state?.phase === 'paused' ? 'resume' : 'pause' }));
  }
  make_steps(): void {
    const ticks = Math.round(Number(this.ticks.value));
    if (this.step.disabled) return;
    void this.send(() => this.connection.command({ command: 'step', ticks }));
  }

  /// A second click within some seconds ends the run.
  private ask_to_stop(): void {
    if (this.stop.dataset['sure'] === 'true') {
      void this.send(() => this.connection.command({ command: 'stop' }));
    }
    const sure = this.stop.dataset['sure'] !== 'true';
    const show = (on: boolean): void => {
      this.stop.dataset['sure'] = String(on);
      this.stop.textContent = on ? 'end the run?' : 'stop';
    };
    show(sure);
    if (sure) setTimeout(() => show(false), 4000);
  }

  private say(text: string, is_wrong = false): void {
    this.note.textContent = text;
    this.note.title = text;
    this.note.classList.toggle('wrong', is_wrong);
  }

  /// Sends a change and shows what became of it.
  private async send(action: () => Promise<Accepted>): Promise<Accepted | undefined> {
    const number = ++this.asked;
    try {
      const accepted = await action();
      if (number === this.asked) this.say(`from t = ${+accepted.time_s.toFixed(6)} s on`);
      return accepted;
    } catch (error) {
      if (error instanceof Refused && error.status === 403) this.make_read_only(error.message);
      else this.say(error instanceof Error ? error.message : String(error), true);
      return undefined;
    }
  }

  private make_read_only(reason: string): void {
    this.say(`read only: ${reason}`);
    for (const part of [this.bar, this.values, this.events]) {
      for (const control of part.querySelectorAll<HTMLInputElement | HTMLButtonElement>('input:not([type=search]), button')) control.disabled = true;
    }
    this.bar.dataset['locked'] = 'true';
  }

  private fill(): void {
    const found = matching(this.settable, this.filter.value);
    this.list.replaceChildren(...found.slice(0, kMostShown).map((signal) => this.entry(signal)));
    if (found.length > kMostShown) this.list.append(element('div', { class: 'lacks' }, `${found.length - kMostShown} more: use the filter`));
    if (found.length === 0) this.list.append(element('div', { class: 'lacks' }, this.settable.length === 0 ? 'the run has nothing that you can set' : 'no match'));
  }

  /// A signal; its sliders are made when it is opened.
  private entry(signal: LiveSignal): HTMLElement {
    const units = [...new Set(signal.units ?? [signal.unit ?? ''])].filter((unit) => unit !== '1');
    const unit = ` ${units.join(', ')}`;
    const box = element('details', { class: 'settable', title: signal.description ?? '' }, element('summary', {}, signal.name, element('span', { class: 'unit' }, unit)));
    box.dataset['name'] = signal.name;
    const open = (): void => {
      if (!box.open) {
        this.opened.delete(signal.name);
        return;
      }
      this.opened.add(signal.name);
      if (box.childElementCount > 1) return;
      const made = element('div', {});
      box.append(made);
      void this.present(signal).then((now) => {
        made.append(...this.rows(signal, now));
        if (this.bar.dataset['locked'] === 'true') this.make_read_only(this.note.textContent?.replace('read only: ', '') ?? '');
      });
    };
    box.addEventListener('toggle', open);
    if (this.opened.has(signal.name)) box.open = true;
    return box;
  }

  /// The present values, or those at the start where the run does not answer.
  private async present(signal: LiveSignal): Promise<LiveElement[]> {
    try {
      const sample = await this.connection.ask<{ values: Record<string, LiveValue> }>('GET', `run/values?names=${encodeURIComponent(signal.name)}`);
      return elements_of(sample.values[signal.name]);
    } catch {
      return elements_of(signal.start);
    }
  }

  private rows(signal: LiveSignal, now: LiveElement[]): HTMLElement[] {
    const rows: Row[] = [];
    const several = signal.size > 1;
    // One value for all has no meaning where they differ.
    const has_all = several && signal.units === undefined;
    const count = Math.min(signal.size, kMostElements);
    // After a refusal the run's own values are shown again.
    const restore = async (): Promise<void> => {
      const values = await this.present(signal);
      rows.forEach((row, i) => row.show(number_of(values[has_all ? Math.max(0, i - 1) : i])));
    };
    if (has_all) rows.push(this.row(signal, 'all', signal.name, number_of(now[0]), (value) => rows.forEach((row) => row.show(value)), restore));
    for (let i = 0; i < count; ++i) {
      const unit = signal.units === undefined ? '' : ` ${signal.units[i]}`;
      rows.push(this.row(signal, several ? `${element_name({ name: signal.name, unit: signal.unit ?? '', count: signal.size, ...(signal.joints && { joints: signal.joints }) }, i)}${unit}` : '', several ? `${signal.name}[${i + 1}]` : signal.name, number_of(now[i]), () => {}, restore));
    }
    const boxes = rows.map((row) => row.box);
    if (signal.size > count) boxes.push(element('div', { class: 'lacks' }, `the elements from ${count + 1} on: by "all" only`));
    if (signal.causality === 'input' && signal.type === 'Real') boxes.push(this.pulse(signal, several));
    return boxes;
  }

  /// A slider and a number, or a check box. `accepted`: called with a value that the run has taken.
  private row(signal: LiveSignal, label: string, name: string, start: number, accepted: (value: number) => void, restore: () => Promise<void>): Row {
    // While a value is on its way, only the newest one waits.
    let waiting: number | undefined;
    let busy = false;
    const send = async (value: number): Promise<void> => {
      waiting = value;
      if (busy) return;
      busy = true;
      while (waiting !== undefined) {
        const next: number = waiting;
        waiting = undefined;
        const taken = await this.send(() => this.connection.set(name, signal.type === 'Boolean' ? next !== 0 : next));
        if (taken === undefined) await restore();
        else if (waiting === undefined) accepted(next);
      }
      busy = false;
    };
    if (signal.type === 'Boolean') {
      const box = element('input', { type: 'checkbox', 'aria-label': name });
      box.checked = start === 1;
      box.addEventListener('change', () => void send(Number(box.checked)));
      return { box: element('label', { class: 'set' }, label, box), show: (value) => (box.checked = value !== 0) };
    }
    const range = slider_range(signal, number_of(elements_of(signal.start)[0]));
    const slider = element('input', { type: 'range', min: String(range.min), max: String(range.max), step: signal.type === 'Integer' ? '1' : 'any', 'aria-label': name });
    const number = element('input', { type: 'number', step: signal.type === 'Integer' ? '1' : 'any', 'aria-label': `${name}, number` });
    const show = (value: number): void => {
      if (!Number.isFinite(value)) return;
      if (value < Number(slider.min)) slider.min = String(value);
      if (value > Number(slider.max)) slider.max = String(value);
      slider.value = String(value);
      number.value = String(+value.toPrecision(6));
    };
    show(Number.isFinite(start) ? start : 0);
    slider.addEventListener('input', () => {
      const value = Number(Number(slider.value).toPrecision(5));
      number.value = String(value);
      void send(value);
    });
    number.addEventListener('change', () => {
      const value = Number(number.value);
      if (number.value === '' || !Number.isFinite(value)) return this.say(`${name}: expected a number`, true);
      void send(value).then(() => {
        if (Number(number.value) === value) show(value);
      });
    });
    return { box: element('div', { class: 'set', title: name }, element('span', {}, label), slider, number), show };
  }

  /// A value for some time of the run.
  private pulse(signal: LiveSignal, several: boolean): HTMLElement {
    const which = element('input', { type: 'number', min: '1', max: String(signal.size), step: '1', value: '1', 'aria-label': `element of a pulse of ${signal.name}` });
    const height = element('input', { type: 'number', step: 'any', value: '10', 'aria-label': `value of a pulse of ${signal.name}` });
    const seconds = element('input', { type: 'number', min: '0.001', step: 'any', value: '0.2', 'aria-label': `duration of a pulse of ${signal.name}, s` });
    const go = async (): Promise<void> => {
      const [value, length, k] = [Number(height.value), Number(seconds.value), Number(which.value)];
      if (!Number.isFinite(value) || !(length > 0)) return this.say('a pulse needs a value and a duration above 0', true);
      const before = number_of((await this.present(signal))[several ? k - 1 : 0]);
      const name = several ? `${signal.name}[${k}]` : signal.name;
      const begun = await this.send(() => this.connection.set(name, value));
      if (begun === undefined) return;
      const back = Number.isFinite(before) ? before : 0;
      // Where that time has passed meanwhile, the pulse ends at once: it must not stay.
      const ended = (await this.send(() => this.connection.set(name, back, begun.time_s + length))) ?? (await this.send(() => this.connection.set(name, back)));
      if (ended !== undefined) this.say(`${name} = ${short(value)} from ${begun.time_s.toFixed(3)} to ${ended.time_s.toFixed(3)} s`);
    };
    return element('div', { class: 'pulse' }, button('pulse', `${signal.name}: this value for this time`, () => void go()), ...(several ? ['[', which, ']'] : []), height, signal.unit ?? '', ' for ', seconds, ' s');
  }

  /// Events of one time are made together: a push, for example, is one for the robot and one for what its controller knows of it.
  private event_entry(together: PlannedEvent[]): HTMLElement {
    const values = Object.fromEntries(together.map(({ name, values }) => [name, values.length === 1 ? values[0]! : values]));
    const texts = together.map(({ name, values }) => `${name} = ${values.map((x) => +x.toPrecision(6)).join(' ')}`);
    const now = button('now', `${texts.join(', ')} now`, () => void this.send(() => this.connection.command({ command: 'set', values })));
    const ramp = Math.max(...together.map((event) => event.ramp_s));
    const text = `${+together[0]!.time_s.toFixed(6)} s: ${texts.join(', ')}`;
    return element('div', { class: 'event' }, now, text, ...(ramp > 0 ? [element('span', { class: 'unit' }, ` (planned over ${ramp} s; now: at once)`)] : []));
  }
}
