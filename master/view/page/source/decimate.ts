import type { Column } from './packed';

/// Least and largest values of blocks of a column, so that a range of any length is drawn from few numbers.
export class Extremes {
  private static readonly kBlock = 16;
  private readonly low: Column[] = [];
  private readonly high: Column[] = [];

  /// `grows`: the numbers change later, so that nothing is kept of blocks.
  constructor(
    private readonly values: Column,
    grows = false,
  ) {
    if (grows) return;
    let low: Column = values;
    let high: Column = values;
    while (low.length > Extremes.kBlock) {
      const blocks = Math.ceil(low.length / Extremes.kBlock);
      const [lower, higher] = values instanceof Float64Array ? [new Float64Array(blocks), new Float64Array(blocks)] : [new Float32Array(blocks), new Float32Array(blocks)];
      for (let b = 0; b < blocks; ++b) {
        let least = Infinity;
        let largest = -Infinity;
        const end = Math.min((b + 1) * Extremes.kBlock, low.length);
        for (let i = b * Extremes.kBlock; i < end; ++i) {
          // A comparison with NaN is false, so that NaN does not count.
          if (low[i]! < least) least = low[i]!;
          if (high[i]! > largest) largest = high[i]!;
        }
        lower[b] = least;
        higher[b] = largest;
      }
      this.low.push(lower);
      this.high.push(higher);
      low = lower;
      high = higher;
    }
  }

  /// Least and largest number of the rows from `begin` to before `end`; [∞, -∞] if there is none.
  range(begin: number, end: number): [number, number] {
    let least = Infinity;
    let largest = -Infinity;
    const take = (level: number, i: number): void => {
      const low = level < 0 ? this.values[i]! : this.low[level]![i]!;
      const high = level < 0 ? this.values[i]! : this.high[level]![i]!;
      if (low < least) least = low;
      if (high > largest) largest = high;
    };
    let level = -1;
    const block = Extremes.kBlock;
    while (begin < end) {
      if (level + 1 >= this.low.length || end - begin < 2 * block) {
        for (let i = begin; i < end; ++i) take(level, i);
        break;
      }
      const first = Math.ceil(begin / block);
      const last = Math.floor(end / block);
      for (let i = begin; i < first * block; ++i) take(level, i);
      for (let i = last * block; i < end; ++i) take(level, i);
      begin = first;
      end = last;
      ++level;
    }
    return [least, largest];
  }
}

/// What a plot of some columns draws: times, and a list of values per column; null where there is no number.
export interface Drawn {
  t: number[];
  values: (number | null)[][];
}

/// The rows from `begin` to before `end`, as at most 2 · buckets points: all rows if they are so few, otherwise the least and the largest value of
/// each bucket of rows, so that no peak is lost.
export function decimate(time: Float64Array, columns: Extremes[], raw: Column[], begin: number, end: number, buckets: number): Drawn {
  const t: number[] = [];
  const values: (number | null)[][] = columns.map(() => []);
  const rows = end - begin;
  const number_or_null = (x: number): number | null => (Number.isFinite(x) ? x : null);
  if (rows <= 2 * buckets) {
    for (let i = begin; i < end; ++i) t.push(time[i]!);
    raw.forEach((column, c) => {
      for (let i = begin; i < end; ++i) values[c]!.push(number_or_null(column[i]!));
    });
    return { t, values };
  }
  for (let b = 0; b < buckets; ++b) {
    const from = begin + Math.floor((b * rows) / buckets);
    const to = begin + Math.floor(((b + 1) * rows) / buckets);
    t.push(time[from]!, time[(from + to) >> 1]!);
    columns.forEach((column, c) => {
      const [least, largest] = column.range(from, to);
      // Rising and falling parts are drawn in their direction.
      const rising = raw[c]![from]! <= raw[c]![to - 1]!;
      values[c]!.push(number_or_null(rising ? least : largest), number_or_null(rising ? largest : least));
    });
  }
  return { t, values };
}
