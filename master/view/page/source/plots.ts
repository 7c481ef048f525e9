import uPlot from 'uplot';
import { kSeries, style_colour } from './colours';
import { Extremes, decimate } from './decimate';
import { button, element, short } from './dom';
import type { Signal } from './format';
import { last_not_above, type Recording } from './recording';

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
  /// Moves the window so that it has the time t in it.
  reveal(t: number): void {
    if (t < this.from || t > this.to) this.show(t - 0.1 * (this.to - this.from), this.to - this.from);
  }
  private show(from: number, length: number): void {
    this.from = Math.min(Math.max(from, this.begin), Math.max(this.begin, this.end - length));
    this.to = Math.min(this.from + length, this.end);
  }
}

/// A plot of the elements of one signal that have the same unit of measure.
export class Plot {
  readonly box: HTMLElement;
  private readonly chart_box = element('div', { class: 'chart' });
  private readonly values: HTMLElement[] = [];
  private readonly mark = element('div', { class: 'mark' });
  private readonly extremes: Extremes[];
  private readonly shown: boolean[];
  private chart: uPlot | undefined;

  private readonly columns: Float32Array[];

  constructor(
    private readonly signal: Signal,
    private readonly unit: string,
    private readonly recording: Recording,
    elements: { column: Float32Array; element: number }[],
    private readonly range: TimeWindow,
    private readonly seek: (t: number) => void,
    private readonly changed: () => void,
    close: () => void,
  ) {
    const columns = (this.columns = elements.map(({ column }) => column));
    this.extremes = columns.map((column) => new Extremes(column, recording.grows));
    this.shown = columns.map(() => true);
    const legend = element('div', { class: 'legend' });
    const name = signal.name;
    elements.forEach(({ element: index }, i) => {
      const number = signal.count > 1 ? `[${index + 1}]` : '';
      const joint = signal.joints?.[index];
      const value = element('span', { class: 'value' });
      this.values.push(value);
      const key = element('span', { class: i < kSeries.length ? 'key' : 'key dashed' });
      key.style.borderTopColor = kSeries[i % kSeries.length]!;
      const entry = element('button', { type: 'button', class: 'entry', 'aria-pressed': 'true', title: `${name}${number}: show or hide this line` }, key, element('span', { class: 'joint' }, `${joint ?? number} `), value);
      entry.addEventListener('click', () => {
        this.shown[i] = !this.shown[i];
        entry.setAttribute('aria-pressed', String(this.shown[i]));
        this.build();
      });
      legend.append(entry);
    });
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
        padding: [6, 20, 0, 0],
        scales: { x: { time: false }, y: { range: (_, low, high) => Plot.padded(low, high) } },
        axes: [{ ...axis, size: 26, values: (_, ticks) => ticks.map((t) => `${+t.toPrecision(10)} s`) }, { ...axis, size: 58, values: (_, ticks) => ticks.map((y) => String(+y.toPrecision(6))) }],
        series: [
          {},
          ...this.columns.map((_, i) => ({
            stroke: kSeries[i % kSeries.length]!,
            width: 1.4,
            show: this.shown[i]!,
            points: { show: false },
            ...(i >= kSeries.length ? { dash: [5, 3] } : {}),
          })),
        ],
      },
      [[], ...this.columns.map(() => [])],
      this.chart_box,
    );
    this.draw();
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
      this.values[i]!.textContent = this.recording.rows > 0 ? short(column[row]!) : '';
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

  private static padded(low: number | null, high: number | null): [number, number] {
    if (low === null || high === null) return [-1, 1];
    if (high - low <= 1e-12 * Math.max(Math.abs(low), Math.abs(high))) return low === 0 ? [-1, 1] : [low - 0.1 * Math.abs(low), high + 0.1 * Math.abs(high)];
    return [low - 0.06 * (high - low), high + 0.06 * (high - low)];
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
