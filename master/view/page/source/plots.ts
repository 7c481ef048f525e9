import uPlot from 'uplot';
import { kSeries, style_colour } from './colours';
import { Extremes, decimate } from './decimate';
import { button, element, round_down, short, tick_labels } from './dom';
import { element_name, type Signal } from './format';
import type { Column } from './packed';
import { kMostLargest, kNoise, last_not_above, type Recording, type Scales } from './recording';

/// A legend has so many entries until it is opened.
const kMostEntries = 8;

/// Width of the longest of the labels of an axis, pixels.
function width_of(chart: uPlot, axis: number, labels: string[] | null): number {
  chart.ctx.font = String(chart.axes[axis]!.font![0]);
  return Math.max(0, ...(labels ?? []).map((label) => chart.ctx.measureText(label).width / devicePixelRatio));
}

/// The range of times that all plots show.
export class TimeWindow {
  constructor(
    public begin: number,
    public end: number,
    public from = begin,
    public to = end,
  ) {}

  /// Of a recording that grows: how much is shown while the page follows it, s.
  private span = 10;
  /// The recording has the times from `begin` to `end` now. `follows`: the newest ones are shown.
  grow(begin: number, end: number, follows: boolean): void {
    this.begin = begin;
    this.end = end;
    const length = follows ? Math.min(this.span, end - begin) : this.to - this.from;
    this.show(follows ? end - length : this.from, length);
  }

  /// Factor below 1: closer. The time `at` stays where it is.
  zoom(factor: number, at: number): void {
    const length = Math.min(Math.max((this.to - this.from) * factor, (this.end - this.begin) * 1e-6), this.end - this.begin);
    const share = this.to > this.from ? (at - this.from) / (this.to - this.from) : 0.5;
    this.span = length;
    this.show(at - share * length, length);
  }
  move(by: number): void {
    this.show(this.from + by, this.to - this.from);
  }
  all(): void {
    this.from = this.begin;
    this.to = this.end;
    this.span = Infinity;
  }
  /// Shows this part of the recording, if there is one.
  set(from: number, to: number): void {
    [from, to] = [Math.max(from, this.begin), Math.min(to, this.end)];
    if (from < to) this.show(from, to - from);
  }
  /// Moves the window so that it has the time t in it.
  reveal(t: number): void {
    if (t < this.from || t > this.to) this.show(t - 0.1 * (this.to - this.from), this.to - this.from);
  }
  private show(from: number, length: number): void {
    this.from = Math.min(Math.max(from, this.begin), Math.max(this.begin, this.end - length));
    this.to = Math.min(this.from + length, this.end);
  }
}

/// Two of about five ticks between these times.
function about_ticks(from: number, to: number): string[] {
  const step = round_down((to - from) / 5);
  const last = Math.floor(to / step) * step;
  return tick_labels([last - step, last]);
}

/// A plot of the elements of one signal that have the same unit of measure.
export class Plot {
  readonly box: HTMLElement;
  private readonly chart_box = element('div', { class: 'chart' });
  private readonly values: HTMLElement[] = [];
  private readonly mark = element('div', { class: 'mark' });
  private readonly extremes: Extremes[];
  private readonly shown: boolean[];
  private readonly entries: HTMLElement[] = [];
  private readonly more = element('button', { type: 'button', class: 'entry more' });
  private is_open = false;
  /// The largest number of the signal; 0 while it grows.
  private readonly largest: number;
  private chart: uPlot | undefined;

  private readonly columns: Column[];

  constructor(
    private readonly signal: Signal,
    private readonly unit: string,
    private readonly recording: Recording,
    elements: { column: Column; element: number }[],
    private readonly scales: Scales,
    private readonly range: TimeWindow,
    private readonly seek: (t: number) => void,
    private readonly changed: () => void,
    close: () => void,
  ) {
    const columns = (this.columns = elements.map(({ column }) => column));
    this.extremes = columns.map((column) => new Extremes(column, recording.grows));
    this.shown = columns.map(() => true);
    this.largest = Math.max(0, ...this.extremes.flatMap((extremes) => (recording.grows ? [] : extremes.range(0, recording.rows).map(Math.abs))).filter(Number.isFinite));
    const legend = element('div', { class: 'legend' });
    const name = signal.name;
    elements.forEach(({ element: index }, i) => {
      const number = signal.count > 1 ? `[${index + 1}]` : '';
      const value = element('span', { class: 'value' });
      this.values.push(value);
      const key = element('span', { class: i < kSeries.length ? 'key' : 'key dashed' });
      key.style.borderTopColor = kSeries[i % kSeries.length]!;
      const entry = element('button', { type: 'button', class: 'entry', 'aria-pressed': 'true', title: `${name}${number}: show or hide this line` }, key, element('span', { class: 'joint' }, number === '' ? '' : `${element_name(signal, index)} `), value);
      entry.addEventListener('click', () => {
        this.shown[i] = !this.shown[i];
        entry.setAttribute('aria-pressed', String(this.shown[i]));
        this.build();
      });
      legend.append(entry);
      this.entries.push(entry);
    });
    this.more.addEventListener('click', () => {
      this.is_open = !this.is_open;
      this.fold();
    });
    if (columns.length > kMostEntries) legend.append(this.more);
    this.fold();
    this.chart_box.append(this.mark);
    this.box = element(
      'section',
      { class: 'plot' },
      element('header', {}, element('h3', {}, name, element('span', { class: 'unit' }, unit === '' || unit === '1' ? '' : ` ${unit}`)), button('×', `remove the plot of ${name}`, close)),
      this.chart_box,
      legend,
    );
    this.listen();
    new ResizeObserver(() => this.build()).observe(this.chart_box);
  }

  get name(): string {
    return this.signal.name;
  }
  /// The name, with the unit of measure where the signal has several.
  get key(): string {
    return this.signal.units === undefined ? this.name : `${this.name} ${this.unit}`;
  }

  /// Makes the chart again: after a change of size, colours or shown lines.
  build(): void {
    const box = this.chart_box.getBoundingClientRect();
    if (box.width < 40) return;
    this.chart?.destroy();
    const axis = { stroke: style_colour('--text'), grid: { stroke: style_colour('--grid'), width: 1 }, ticks: { stroke: style_colour('--grid'), width: 1 } };
    this.chart = new uPlot(
      {
        width: Math.floor(box.width),
        height: Math.floor(box.height),
        legend: { show: false },
        cursor: { show: false },
        padding: [6, (chart) => Math.max(20, 3 + width_of(chart, 0, (chart.axes[0] as { _values?: string[] })._values ?? null) / 2), 0, 0],
        scales: { x: { time: false }, y: { range: (_, low, high) => this.padded(low, high) } },
        axes: [
          { ...axis, size: 26, space: (chart, i, from, to) => 34 + width_of(chart, i, about_ticks(from, to)), values: (_, ticks) => tick_labels(ticks).map((t) => `${t} s`) },
          { ...axis, size: (chart, labels, i) => Math.max(58, 17 + width_of(chart, i, labels)), values: (_, ticks) => tick_labels(ticks) },
        ],
        series: [
          {},
          ...this.columns.map((_, i) => ({
            stroke: kSeries[i % kSeries.length]!,
            width: 1.4,
            show: this.shown[i]!,
            points: { show: this.recording.rows === 1 }, // a single row has no line
            ...(i >= kSeries.length ? { dash: [5, 3] } : {}),
          })),
        ],
      },
      [[], ...this.columns.map(() => [])],
      this.chart_box,
    );
    this.draw();
  }

  /// Of many lines the legend has those that move most, and the rest when it is opened.
  fold(): void {
    if (this.entries.length <= kMostEntries) return;
    const moves = this.extremes.map((extremes) => {
      const [low, high] = extremes.range(0, this.recording.rows);
      return high - low;
    });
    const moving = [...moves.keys()].filter((i) => moves[i]! > this.least).sort((i, k) => moves[k]! - moves[i]!).slice(0, kMostEntries);
    this.entries.forEach((entry, i) => (entry.hidden = !this.is_open && !moving.includes(i)));
    this.more.textContent = this.is_open ? 'fewer' : `${this.entries.length - moving.length} more`;
    this.more.title = this.is_open ? 'the lines that move most' : 'all lines';
  }

  /// Draws the range of times that is shown now.
  draw(): void {
    if (this.chart === undefined) return;
    const { time, rows } = this.recording;
    if (rows === 0) return;
    const begin = Math.max(0, last_not_above(time, this.range.from, rows) - 1);
    const end = Math.min(rows, last_not_above(time, this.range.to, rows) + 2);
    const drawn = decimate(time, this.extremes, this.columns, begin, end, Math.max(50, Math.floor(this.chart.bbox.width / devicePixelRatio)));
    this.chart.batch(() => {
      this.chart!.setData([drawn.t, ...drawn.values] as uPlot.AlignedData, false);
      const alone = this.range.to > this.range.from ? 0 : 0.5;
      this.chart!.setScale('x', { min: this.range.from - alone, max: this.range.to + alone });
    });
  }

  /// Puts the mark at the time t and writes the values of the nearest row.
  follow(t: number): void {
    const row = this.recording.nearest(t);
    this.columns.forEach((column, i) => {
      const y = column[row]!;
      this.values[i]!.textContent = this.recording.rows > 0 ? short(Math.abs(y) < this.least ? 0 : y) : '';
    });
    if (this.chart === undefined) return;
    const x = this.chart.valToPos(t, 'x') + this.chart.bbox.left / devicePixelRatio;
    this.mark.style.transform = `translateX(${x}px)`;
    this.mark.style.visibility = t < this.range.from || t > this.range.to ? 'hidden' : 'visible';
  }

  /// What the plot tells at the mark.
  texts(): string[] {
    return this.values.map((value) => value.textContent ?? '');
  }

  destroy(): void {
    this.chart?.destroy();
    this.box.remove();
  }

  /// Numbers below it are rounding errors.
  private get least(): number {
    const own = this.unit === '1' && this.largest <= kMostLargest ? kNoise * this.largest : 0;
    return Math.max(this.scales.least(this.unit), own);
  }
  private padded(low: number | null, high: number | null): [number, number] {
    if (low === null || high === null) return [-1, 1];
    const [size, least] = [Math.max(Math.abs(low), Math.abs(high)), this.least];
    if (high - low <= 1e-12 * size) return size <= least ? [-1, 1] : [low - 0.1 * size, high + 0.1 * size];
    if (size <= least) return [-least, least];
    const beyond = Math.max(0.06 * (high - low), least - (high - low) / 2);
    return [low - beyond, high + beyond];
  }

  private time_at(event: MouseEvent): number {
    const over = this.chart!.over.getBoundingClientRect();
    return this.chart!.posToVal(event.clientX - over.left, 'x');
  }

  /// Drag: the time. With Shift: the shown range. Wheel: closer or farther. Double click: everything.
  private listen(): void {
    let panning: number | undefined;
    let dragging = false;
    this.chart_box.addEventListener('pointerdown', (event) => {
      if (this.chart === undefined || event.button > 1) return;
      this.chart_box.setPointerCapture(event.pointerId);
      event.preventDefault();
      if (event.shiftKey || event.button === 1) panning = this.time_at(event);
      else {
        dragging = true;
        this.seek(this.time_at(event));
      }
    });
    this.chart_box.addEventListener('pointermove', (event) => {
      if (this.chart === undefined) return;
      if (panning !== undefined) {
        this.range.move(panning - this.time_at(event));
        this.changed();
      } else if (dragging) {
        this.seek(this.time_at(event));
      }
    });
    const release = (): void => {
      panning = undefined;
      dragging = false;
    };
    this.chart_box.addEventListener('pointerup', release);
    this.chart_box.addEventListener('pointercancel', release);
    this.chart_box.addEventListener(
      'wheel',
      (event) => {
        if (this.chart === undefined) return;
        event.preventDefault();
        if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.range.move(((this.range.to - this.range.from) * event.deltaX) / 1000);
        else this.range.zoom(Math.exp(event.deltaY / 400), this.time_at(event));
        this.changed();
      },
      { passive: false },
    );
    this.chart_box.addEventListener('dblclick', () => {
      this.range.all();
      this.changed();
    });
  }
}
