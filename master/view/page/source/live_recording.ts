import type { Signal } from './format';
import { Recording, Scales } from './recording';

/// A value in a message of the run: an element or all elements. null: not a finite number.
export type LiveElement = number | boolean | null;
export type LiveValue = LiveElement | LiveElement[];

export interface LiveSample {
  tick: number;
  time_s: number;
  values: Record<string, LiveValue>;
  lost: number;
}

/// What a stream may ask for (docs/gateway_run.md).
const kMostElements = 1024;
const kMostNames = 256;
const kLongestQuery = 3600;

function number_of(value: LiveElement | undefined): number {
  return typeof value === 'boolean' ? Number(value) : (value ?? NaN);
}

/// The last minutes of a run, row by row as they come. The arrays of times and values stay the same ones: when they are full, the older half is
/// dropped. A signal has numbers from its first load on.
export class LiveRecording extends Recording {
  private count = 0;
  private readonly held = new Map<string, Float32Array[]>();
  private readonly waiting = new Map<string, (() => void)[]>();
  readonly scales = new Scales();
  /// Called when further signals are needed, with all names.
  ordered: (names: string[]) => void = () => {};
  /// Rows that came so far, so that a change can be noticed.
  taken = 0;

  /// `capacity`: rows; at least half of them are kept.
  constructor(
    signals: Signal[],
    readonly capacity = 14_400,
  ) {
    super({ rows: 0, time: { at: 0, size: 0, count: 0, kind: 'whole', order: 0 }, columns: [], signals }, '');
    this.time = new Float64Array(capacity);
  }

  override get grows(): boolean {
    return true;
  }
  override get rows(): number {
    return this.count;
  }
  override open(): Promise<void> {
    return Promise.resolve();
  }
  get names(): string[] {
    return [...this.held.keys()];
  }

  /// Asks for a signal. Returns when its first number has come, or after `patience` ms. Throws Error if the stream has no room for it.
  override async load(name: string, patience = 3000): Promise<boolean> {
    const signal = this.signal(name);
    if (signal === undefined) return false;
    if (this.held.has(name) && !this.waiting.has(name)) return true;
    if (!this.held.has(name)) {
      const names = [...this.held.keys(), name];
      const elements = names.reduce((sum, known) => sum + (this.signal(known)?.count ?? 0), 0);
      if (elements > kMostElements || names.length > kMostNames || names.map(encodeURIComponent).join(',').length > kLongestQuery)
        throw new Error(`${name} is not shown: the page has all the signals that one stream can have`);
      this.held.set(name, Array.from({ length: signal.count }, () => new Float32Array(this.capacity).fill(NaN)));
      this.waiting.set(name, []);
      this.ordered(names);
    }
    await new Promise<void>((resolve) => {
      const timer = setTimeout(resolve, patience);
      this.waiting.get(name)!.push(() => {
        clearTimeout(timer);
        resolve();
      });
    });
    return true;
  }
  override values(name: string): Float32Array[] | undefined {
    return this.held.get(name);
  }

  /// Adds a row, or replaces the last one if the time is the same: values that were set in a paused run. A row of an earlier time begins anew.
  take(sample: LiveSample): void {
    const last = this.count > 0 ? this.time[this.count - 1]! : -Infinity;
    if (sample.time_s < last) this.clear();
    if (sample.time_s === last) --this.count;
    if (this.count === this.capacity) this.drop(this.capacity >> 1);
    const row = this.count++;
    this.time[row] = sample.time_s;
    for (const [name, columns] of this.held) {
      const value = sample.values[name];
      const { unit, units } = this.signal(name)!;
      columns.forEach((column, i) => {
        column[row] = number_of(Array.isArray(value) ? value[i] : i === 0 ? value : undefined);
        this.scales.note(units?.[i] ?? unit, column[row]!);
      });
      if (value === undefined) continue;
      for (const came of this.waiting.get(name) ?? []) came();
      this.waiting.delete(name);
    }
    ++this.taken;
  }

  private drop(rows: number): void {
    this.time.copyWithin(0, rows, this.count);
    for (const columns of this.held.values()) {
      for (const column of columns) column.copyWithin(0, rows, this.count).fill(NaN, this.count - rows);
    }
    this.count -= rows;
  }
  private clear(): void {
    this.count = 0;
    for (const columns of this.held.values()) for (const column of columns) column.fill(NaN);
  }
}
