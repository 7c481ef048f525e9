import { short } from './dom';
import type { Signal, Table } from './format';
import { unpack, type Column } from './packed';

/// Index of the last of the first `count` elements that is not above x; 0 if all are. There is at least one element.
export function last_not_above(sorted: ArrayLike<number>, x: number, count = sorted.length): number {
  let low = 0;
  let high = count - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (sorted[middle]! <= x) low = middle;
    else high = middle - 1;
  }
  return low;
}

/// Two rows and the share of the second in what lies between them.
export interface Place {
  row: number;
  next: number;
  share: number;
}

/// Rounding errors: numbers that are below this share of the largest one in the run in their unit of measure.
export const kNoise = 1e-9;
/// Larger numbers, such as 1e12 for "none", are not taken for the largest one (master/view/view.cpp has the same bound).
export const kMostLargest = 1e6;
/// Units without a size of their own: counts and states, and times, of which small ones are exact.
const kOwnSizes = ['', '1', 's'];
/// The torques of joints come from forces at levers of about 1 m, so both have one size; so have their motions.
const size_of = (unit: string): string => unit.replace('N.m', 'N').replace('rad', 'm');

/// What is as good as 0.
export class Scales {
  private readonly largest = new Map<string, number>();
  constructor(known: Record<string, number> = {}) {
    for (const [unit, x] of Object.entries(known)) this.note(unit, x);
  }
  note(unit: string, x: number): void {
    const [name, size] = [size_of(unit), Math.abs(x)];
    if (size <= kMostLargest && size > (this.largest.get(name) ?? 0)) this.largest.set(name, size);
  }
  /// Numbers in this unit that are below it are none; 0 if that is not known.
  least(unit: string): number {
    return kOwnSizes.includes(unit) ? 0 : kNoise * (this.largest.get(size_of(unit)) ?? 0);
  }
  text(x: number, unit: string): string {
    return short(Math.abs(x) < this.least(unit) ? 0 : x);
  }
}

/// A table whose columns are unpacked when they are first needed. Times in s.
export class Recording {
  time: Float64Array = new Float64Array(0);
  private readonly columns = new Map<number, Column>();
  private readonly pending = new Map<number, Promise<Column>>();
  private readonly by_name = new Map<string, Signal>();

  constructor(
    readonly table: Table,
    private readonly text: string,
  ) {
    for (const signal of table.signals) this.by_name.set(signal.name, signal);
  }

  async open(): Promise<void> {
    const ns = await unpack(this.text, this.table.time);
    this.time = Float64Array.from(ns, (t) => t / 1e9);
  }

  /// Whether rows are added.
  get grows(): boolean {
    return false;
  }
  get rows(): number {
    return this.table.rows;
  }
  signal(name: string): Signal | undefined {
    return this.by_name.get(name);
  }
  /// Unpacks the columns of a signal. Returns whether there is such a signal.
  async load(name: string): Promise<boolean> {
    const signal = this.signal(name);
    if (signal === undefined) return false;
    await Promise.all(Array.from({ length: signal.count }, (_, i) => this.column(signal.first + i)));
    return true;
  }
  column(index: number): Promise<Column> {
    let found = this.pending.get(index);
    if (found === undefined) {
      found = unpack(this.text, this.table.columns[index]!).then((values) => {
        this.columns.set(index, values);
        return values;
      });
      this.pending.set(index, found);
    }
    return found;
  }
  /// The columns of a signal that was loaded; undefined otherwise.
  values(name: string): Column[] | undefined {
    const signal = this.signal(name);
    if (signal === undefined) return undefined;
    const columns: Column[] = [];
    for (let i = 0; i < signal.count; ++i) {
      const column = this.columns.get(signal.first + i);
      if (column === undefined) return undefined;
      columns.push(column);
    }
    return columns;
  }

  /// The row that is nearest to the time t.
  nearest(t: number): number {
    const { row, next, share } = this.place(t);
    return share < 0.5 ? row : next;
  }
  place(t: number): Place {
    if (this.rows === 0) return { row: 0, next: 0, share: 0 };
    const row = last_not_above(this.time, t, this.rows);
    const next = Math.min(row + 1, this.rows - 1);
    const length = this.time[next]! - this.time[row]!;
    const share = length > 0 ? Math.min(Math.max((t - this.time[row]!) / length, 0), 1) : 0;
    return { row, next, share };
  }
}

/// Signals whose values hold until the next row.
const kHeld = /\.(contact_p|contact_f|closed|zone|present|scale|ranges|p_scan|quat_scan)$/;

/// A recording with the signals that only another one has, at its own times.
export class Joined extends Recording {
  private readonly taken = new Map<string, Column[]>();

  constructor(
    private readonly base: Recording,
    private readonly other: Recording,
  ) {
    super(base.table, '');
  }
  override open(): Promise<void> {
    this.time = this.base.time;
    return Promise.resolve();
  }
  override signal(name: string): Signal | undefined {
    return this.base.signal(name) ?? this.other.signal(name);
  }
  override async load(name: string): Promise<boolean> {
    if (this.base.signal(name) !== undefined) return this.base.load(name);
    if (!(await this.other.load(name))) return false;
    const held = kHeld.test(name);
    const at = (column: Column, t: number): number => {
      const place = this.other.place(t);
      return held ? column[place.share === 1 ? place.next : place.row]! : between(column, place);
    };
    this.taken.set(
      name,
      this.other.values(name)!.map((column) => {
        const values = this.time.map((t) => at(column, t));
        return column instanceof Float64Array ? values : Float32Array.from(values);
      }),
    );
    return true;
  }
  override values(name: string): Column[] | undefined {
    return this.base.signal(name) !== undefined ? this.base.values(name) : this.taken.get(name);
  }
}

/// The value of a column between two rows; that of the other row where one is not finite.
export function between(column: Column, { row, next, share }: Place): number {
  const a = column[row]!;
  const b = column[next]!;
  if (share === 0 || !Number.isFinite(b)) return a;
  if (!Number.isFinite(a)) return b;
  return a + share * (b - a);
}
