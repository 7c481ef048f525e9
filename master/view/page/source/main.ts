import 'uplot/dist/uPlot.min.css';
import './style.css';
import * as three from 'three';
import { Connection, Refused, type LiveSignal, type RunFacts } from './connection';
import { CloudView, Marks } from './clouds';
import { Controls } from './controls';
import { Instances } from './instances';
import { Lights } from './lights';
import { cues_of, type Cue } from './cues';
import { button, element } from './dom';
import { kRoles } from './colours';
import { BodyView, FigureView, needed_signals } from './figures';
import type { PageData, Robot, Signal, Visual } from './format';
import { reach_of } from './kinematics';
import { read_view, write_view, type View } from './link';
import { LiveRecording } from './live_recording';
import { LiveMatrices, RecordedMatrices, type Matrices } from './matrices';
import { matte } from './materials';
import { load_meshes } from './meshes';
import { looks_of } from './shapes';
import { unpack } from './packed';
import { Player } from './player';
import { show_gateway } from './gateway';
import { Plot, TimeWindow } from './plots';
import { Joined, Recording, Scales } from './recording';
import { Stage } from './stage';
import { Surroundings } from './surroundings';

/// So many notes are open at the beginning.
const kMostOpenNotes = 2;

const kKeys: [string, string][] = [
  ['Space', 'play or stop'],
  ['← →', 'one row back or on; with Shift a fiftieth of what the plots show'],
  ['Home End', 'beginning and end'],
  ['+ -', 'faster, slower'],
  ['[ ]', 'plots: closer, farther'],
  ['0', 'plots: the whole recording; view: everything'],
  ['d', 'dark or light'],
  ['?', 'this page'],
];

const kLiveKeys: [string, string][] = [
  ['p', 'pause or resume the run'],
  ['.', 'make some ticks of the run, then pause'],
];
const kRefresh = 500; // ms between two choices of sizes while a run goes on
const kRedraw = 50; // ms between two drawings of the plots meanwhile
const kTexts = 150; // ms between two changes of the figures of cues meanwhile
const kStill = 400; // ms without a new row, after which the picture rests

const kMostPlots = 20; // of a link
const kMostReach = 0.6; // heights of the view
const kRemember = 400; // ms between two changes of the URL

/// A run that goes on.
interface Live {
  connection: Connection;
  controls: Controls;
  recording: LiveRecording;
}

/// The text of a script element that holds data.
function content_of(id: string): string {
  return document.getElementById(id)?.textContent ?? '';
}

class Page {
  private readonly app = document.getElementById('app')!;
  private calculated: Matrices | undefined;
  private player = new Player(0, 0);
  private range = new TimeWindow(0, 0);
  private stage!: Stage;
  private figures: FigureView[] = [];
  private bodies: BodyView[] = [];
  private clouds: CloudView[] = [];
  private readonly marks = new Marks();
  private cues: Cue[] = [];
  private surroundings!: Surroundings;
  private ground = new three.Box3();
  private readonly scales: Scales;
  private readonly remarked = new Set<string>();
  private readonly shown = new Set<string>();
  private readonly built = new Set<string>();
  private readonly entries = new Map<string, { box: HTMLInputElement; text: HTMLElement }>();
  private plots: Plot[] = [];
  private first_plots: string[] = [];
  private readonly lights: Lights;
  private dirty = true;
  private last = 0;
  private readonly frames: number[] = [];
  private taken = 0;
  private grown = -Infinity;
  private refreshed = 0;
  private redrawn = 0;
  private written = 0;

  private readonly canvas = element('canvas', { tabindex: '0', 'aria-label': '3D view: drag to turn, right button to move, wheel to come closer' });
  private readonly play = button('▶', 'play or stop (Space)', () => this.toggle());
  private readonly slider = element('input', { type: 'range', min: '0', max: '1', step: 'any', value: '0', 'aria-label': 'time' });
  private readonly clock = element('output', {});
  private readonly speed = element('select', { 'aria-label': 'speed' });
  private readonly plot_list = element('div', {});
  private readonly remarks = element('ul', {});
  private readonly count = element('summary', {});
  private readonly notes = element('details', { class: 'remarks', hidden: '' }, this.count, this.remarks);
  private readonly help = element('dialog', {});
  private readonly state = element('span', { class: 'state', role: 'status' });
  private readonly now = button('live', 'show the newest time (End)', () => this.follow());

  /// What the 3D view and the cues draw from.
  private readonly scenery: Recording;

  /// `numbers`: packed, base64. `live`: undefined for a recording. `view`: what pages show beside it.
  constructor(
    private readonly data: PageData,
    private readonly recording: Recording,
    private readonly numbers: string,
    private readonly live?: Live,
    private readonly view?: Recording,
  ) {
    if (view === undefined) this.scenery = recording;
    else this.scenery = recording.rows >= view.rows ? new Joined(recording, view) : new Joined(view, recording);
    this.scales = live?.recording.scales ?? new Scales(data.scales);
    this.lights = new Lights(data.lights, this.scenery);
  }

  async open(): Promise<void> {
    const { data, live } = this;
    document.title = `${data.name} · cotwin ${live === undefined ? 'view' : 'live'}`;
    const table = data.tables[1];
    const calculated = table === undefined ? undefined : new Recording(table, this.numbers);
    if (calculated !== undefined) this.calculated = new RecordedMatrices(calculated);
    const needed = needed_signals(data);
    // The time alone is worth a stream, too.
    const first = live !== undefined && needed.length === 0 ? this.recording.table.signals.slice(0, 1).map((signal) => signal.name) : needed;
    let refused = 0;
    await Promise.all([this.recording.open(), this.view?.open(), calculated?.open()]);
    if (this.view !== undefined) await this.scenery.open();
    await Promise.all(first.map((name) => this.scenery.load(name).catch(() => ++refused)));
    if (refused > 0) this.remark(`${refused} of the ${first.length} signals of robots and bodies are more than a stream can have: what they move stands still`);
    const { time, rows } = this.recording;
    this.player = new Player(rows > 0 ? time[0]! : 0, rows > 0 ? time[rows - 1]! : 0, live !== undefined);
    this.range = new TimeWindow(this.player.begin, this.player.end);
    this.lay_out();
    for (const remark of data.remarks) this.remark(remark);
    if (rows === 0 && live === undefined) this.remark('the recording has no rows: only the start is shown');
    const view = read_view(location.hash);
    this.first_plots = data.plots.filter((name) => this.all_signals().some((signal) => signal.name === name));
    const linked = view.plots?.filter((name) => name === '' || this.all_signals().some((signal) => signal.name === name)).slice(0, kMostPlots);
    const plotted = (linked?.length ? linked : this.first_plots).map((name) => this.add_plot(name));
    try {
      await this.set_the_stage();
    } catch (error) {
      this.remark(`no 3D view: ${error instanceof Error ? error.message : String(error)}`);
    }
    await Promise.all(plotted);
    if (live !== undefined) this.watch(live);
    this.listen();
    await this.restore(view);
    this.remember();
    this.update();
    requestAnimationFrame((now) => this.frame(now));
  }

  /// Poses in the world, as column-major matrices: of all bodies of a robot and of its tip, of a body of the scene, of a tool. For tests.
  poses(figure: number): { bodies: number[][]; tip: number[] } {
    const view = this.figures[figure]!;
    return { bodies: view.main.poses.map((pose) => pose.clone().premultiply(view.base).toArray()), tip: view.frame(view.robot.tip).toArray() };
  }
  body_pose(name: string): number[] | undefined {
    return this.bodies.find((view) => view.body.name === name)?.group.matrix.toArray();
  }
  /// null: not mounted at this time.
  tool_pose(figure: number, name: string): number[] | null {
    return this.figures[figure]!.tool_pose(name);
  }
  seek(t: number): void {
    this.player.seek(t);
    this.update();
  }
  get time(): number {
    return this.player.time;
  }
  plot_values(): Record<string, string[]> {
    return Object.fromEntries(this.plots.map((plot) => [plot.key, plot.texts()]));
  }
  /// Frames per second of the last 60 frames while playing.
  get rate(): number {
    const n = this.frames.length;
    return n < 2 ? 0 : ((n - 1) * 1000) / (this.frames[n - 1]! - this.frames[0]!);
  }

  /// Shows what the connection tells.
  private watch({ connection, controls }: Live): void {
    const words = { connecting: 'connecting', open: 'live', lost: 'no connection, trying again', ended: 'the run has ended; the page keeps what it has' };
    const show = (): void => {
      const phase = connection.state?.phase;
      this.state.textContent = connection.link === 'open' && phase === 'paused' ? 'paused' : words[connection.link];
      this.state.dataset['link'] = connection.link;
      controls.update();
    };
    connection.on_change = show;
    connection.on_other_run = () => location.reload();
    show();
  }

  /// Cues, camera, range and time of a link; what the page does not have is left out.
  private async restore({ cues, camera, range, t }: View): Promise<void> {
    for (const cue of this.cues) if (cues?.includes(cue.id)) await this.switch_cue(cue, true);
    if (camera !== undefined && this.stage !== undefined) this.stage.view = camera;
    if (range !== undefined) this.range.set(range[0]!, range[1]!);
    if (t !== undefined) this.seek(t);
    this.draw_plots();
  }
  /// Keeps the view in the address. A link that is followed from this page loads it again.
  private remember(): void {
    addEventListener('hashchange', () => location.reload());
    let last = '';
    setInterval(() => {
      const hash = write_view(this.seen());
      if (hash !== last) history.replaceState(null, '', `#${hash}`);
      last = hash;
    }, kRemember);
  }
  /// What a link to the present view has.
  private seen(): View {
    const { range, player, stage } = this;
    const order = (a: Plot, b: Plot): number => (a.box.compareDocumentPosition(b.box) & Node.DOCUMENT_POSITION_FOLLOWING ? -1 : 1);
    const plots = [...new Set([...this.plots].sort(order).map((plot) => plot.name))];
    const cues = this.cues.filter((cue) => this.shown.has(cue.id)).map((cue) => cue.id);
    return {
      ...(player.time !== player.begin && !player.following && { t: player.time }),
      ...((range.from !== range.begin || range.to !== range.end) && this.live === undefined && { range: [range.from, range.to] }),
      ...(stage?.chosen && { camera: stage.view }),
      ...(cues.length > 0 && { cues }),
      ...(plots.join('\n') !== this.first_plots.join('\n') && { plots: plots.length > 0 ? plots : [''] }),
    };
  }
  private follow(): void {
    this.player.follow();
    this.update();
  }

  private lay_out(): void {
    const { data, live } = this;
    const facts = element('table', {}, ...data.facts.map(([name, value]) => element('tr', {}, element('td', {}, name), element('td', {}, value))));
    const keys = element('table', {});
    const close = button('close', 'close', () => this.help.close());
    this.help.append(close, element('h2', {}, 'Keys'), keys, element('h2', {}, 'In a plot'), element('p', {}, 'Drag: the time. Shift and drag: the shown range. Wheel: closer, farther. Double click: everything.'), element('h2', {}, 'This run'), facts);
    const add = element('select', { 'aria-label': 'add a plot' }, element('option', { value: '' }, 'add a plot …'));
    for (const signal of this.all_signals()) add.append(element('option', { value: signal.name }, signal.count > 1 ? `${signal.name} (${signal.count})` : signal.name));
    add.addEventListener('change', () => {
      void this.add_plot(add.value);
      add.value = '';
      add.blur();
    });
    for (const speed of Player.kSpeeds) this.speed.append(element('option', { value: String(speed) }, `${speed} ×`));
    this.speed.addEventListener('change', () => {
      this.player.speed = Number(this.speed.value);
      this.speed.blur();
    });
    this.slider.min = String(this.player.begin);
    this.slider.max = String(this.player.end);
    this.slider.addEventListener('input', () => this.seek(Number(this.slider.value)));
    const panel = element('details', { class: 'panel' }, element('summary', {}, 'Cues'));
    // On a phone there is room for the plots only.
    panel.open = matchMedia('(min-width: 821px)').matches;
    if (live !== undefined) live.controls.values.open = panel.open;
    panel.id = 'cues';
    const side = element('div', { class: 'cues' }, panel);
    if (live !== undefined) side.append(live.controls.values, live.controls.events);
    else this.now.hidden = true;
    this.state.textContent = data.state;
    this.app.append(
      element(
        'div',
        { class: 'top' },
        element('h1', {}, data.name),
        this.state,
        ...(live === undefined ? [] : [live.controls.bar]),
        element('span', { class: 'space' }),
        button('view all', 'put everything into view (0)', () => this.view_all()),
        button('dark / light', 'dark or light (d)', () => this.change_theme()),
        button('?', 'keys and facts (?)', () => this.show_help()),
      ),
      side,
      element('div', { class: 'stage' }, this.canvas, this.lights.panel, this.notes),
      element('aside', { class: 'side' }, element('div', { class: 'add' }, add), this.plot_list),
      element('div', { class: 'line' }, this.play, this.speed, this.slider, this.clock, this.now),
      this.help,
    );
    for (const [key, what] of live === undefined ? kKeys : [...kKeys, ...kLiveKeys]) keys.append(element('tr', {}, element('td', {}, key), element('td', {}, what)));
    keys.id = 'keys';
  }

  /// What was recorded by choice, then what pages show.
  private all_signals(): Signal[] {
    const beside = this.view?.table.signals.filter((signal) => this.recording.signal(signal.name) === undefined) ?? [];
    return [...this.recording.table.signals, ...beside];
  }

  private remark(text: string): void {
    if (this.remarked.has(text)) return;
    this.remarked.add(text);
    this.remarks.append(element('li', {}, text));
    const count = this.remarks.childElementCount;
    this.count.textContent = count === 1 ? '1 note' : `${count} notes`;
    this.notes.hidden = false;
    // A few are shown; many would cover the view.
    this.notes.open = count <= kMostOpenNotes;
  }

  private async set_the_stage(): Promise<void> {
    const { data } = this;
    const points = new Map<object, Float32Array>();
    const visuals: Visual[] = [...data.robots.flatMap((robot) => [...robot.visuals, ...robot.solids].flat()), ...data.bodies.flatMap((body) => body.visuals), ...data.figures.flatMap((figure) => figure.tools.flatMap((tool) => tool.visuals))];
    const [meshes, clouds] = await Promise.all([
      load_meshes(data.meshes, this.numbers, (text) => this.remark(text)),
      Promise.all((data.clouds ?? []).map((cloud) => CloudView.make(cloud, this.numbers, this.marks))),
      ...visuals.map(async (visual) => {
        if (visual.points !== undefined) points.set(visual, Float32Array.from(await unpack(this.numbers, visual.points)));
      }),
    ]);
    this.stage = new Stage(this.canvas);
    const of = (visual: object): Float32Array | undefined => points.get(visual);
    this.figures = data.figures.map((figure) => new FigureView(figure, data.robots[figure.robot]!, this.scenery, of, meshes));
    const fixed = matte({ color: '#aab3bf', side: three.DoubleSide });
    const moving = matte({ color: '#56a0c9', side: three.DoubleSide });
    const ghost = looks_of(kRoles.other, 0.3).body;
    const instances = new Instances();
    this.bodies = data.bodies.map((body) => new BodyView(body, this.scenery, of, meshes, body.ghost ? ghost : body.fixed ? fixed : moving, instances));
    instances.build();
    this.clouds = clouds;
    this.stage.scene.add(instances.group, ...[...this.figures, ...this.bodies, ...clouds].map((view) => view.group));
    const place = this.scenery.place(this.player.time);
    for (const view of [...this.figures, ...this.bodies]) view.place(place, this.player.time);
    this.surroundings = new Surroundings(this.figures, this.bodies, this.clouds, this.scenery, () => this.player.time);
    const first = this.surroundings.at_first();
    this.stage.look_at(first);
    this.ground = this.surroundings.above_ground(first);
    this.dress();
    this.add_cues();
  }

  private dress(): void {
    this.stage?.dress(this.ground, Math.max(1.5, ...this.figures.map((view) => 1.2 * reach_of(view.robot))));
  }

  private add_cues(): void {
    const { data, scenery: recording, figures, bodies } = this;
    if (this.live !== undefined) this.calculated = new LiveMatrices(recording, figures);
    const calculated = this.calculated;
    const size = (robot: Robot): number => Math.min(reach_of(robot), kMostReach * this.stage.span);
    const scenery = { data, recording, calculated, figures, bodies, scene: this.stage.scene, marks: this.marks, scales: this.scales, longest: () => this.stage.span / 3, size };
    this.cues = cues_of(scenery, figures.length > 0 ? Math.max(0.3, ...figures.map((view) => size(view.robot))) : 1);
    const panel = document.getElementById('cues')!;
    const keys = document.getElementById('keys')!;
    for (const cue of this.cues) {
      const box = element('input', { type: 'checkbox' });
      const text = element('div', { class: 'figures' });
      const swatch = element('span', { class: 'swatch' });
      swatch.style.background = cue.lacks === '' ? cue.colour : 'transparent';
      box.disabled = cue.lacks !== '';
      const label = element('label', {}, box, swatch, cue.label, element('kbd', {}, cue.key));
      const entry = element('div', { class: 'cue', 'data-cue': cue.id }, label, text);
      if (cue.lacks !== '') {
        label.className = 'lacking';
        entry.title = `no data: ${cue.lacks}`;
      }
      if (cue.content !== undefined) entry.append(cue.content);
      panel.append(entry);
      this.entries.set(cue.id, { box, text });
      box.addEventListener('change', () => void this.switch_cue(cue, box.checked));
      keys.append(element('tr', {}, element('td', {}, cue.key), element('td', {}, cue.label)));
    }
  }

  private async switch_cue(cue: Cue, on: boolean): Promise<void> {
    const entry = this.entries.get(cue.id)!;
    if (cue.lacks !== '') return;
    entry.box.checked = on;
    if (on && !this.built.has(cue.id)) {
      this.built.add(cue.id);
      try {
        await Promise.all([...cue.needs.map((name) => this.scenery.load(name)), ...cue.calculates.map((name) => this.calculated!.load(name))]);
      } catch (error) {
        this.remark(error instanceof Error ? error.message : String(error));
      }
      cue.build();
    }
    if (on) this.shown.add(cue.id);
    else this.shown.delete(cue.id);
    cue.show(on);
    if (!on) entry.text.textContent = '';
    this.update();
  }

  private async add_plot(name: string): Promise<void> {
    const source = this.recording.signal(name) === undefined && this.view !== undefined ? this.view : this.recording;
    const signal = source.signal(name);
    if (signal === undefined || this.plots.some((plot) => plot.name === name)) return;
    const slot = element('div', {});
    this.plot_list.append(slot);
    try {
      await source.load(name);
    } catch (error) {
      slot.remove();
      return this.remark(error instanceof Error ? error.message : String(error));
    }
    // One for each unit of measure.
    const units = signal.units ?? [signal.unit];
    for (const unit of new Set(units)) {
      const plot: Plot = new Plot(
        signal,
        unit,
        source,
        source.values(name)!.map((column, i) => ({ column, element: i })).filter(({ element: i }) => (units[i] ?? unit) === unit),
        this.scales,
        this.range,
        (t) => this.seek(t),
        () => this.draw_plots(),
        () => {
          this.plots = this.plots.filter((other) => other !== plot);
          plot.destroy();
        },
      );
      this.plots.push(plot);
      slot.append(plot.box);
      plot.build();
      plot.follow(this.player.time);
    }
  }

  private draw_plots(): void {
    for (const plot of this.plots) {
      plot.draw();
      plot.follow(this.player.time);
    }
  }

  private view_all(): void {
    if (this.stage === undefined) return;
    this.stage.chosen = true;
    this.stage.look_at(this.surroundings.everything());
  }

  private show_help(): void {
    this.help.showModal();
    this.help.scrollTop = 0;
  }

  private change_theme(): void {
    const dark = getComputedStyle(document.documentElement).getPropertyValue('--panel').trim() !== '#ffffff';
    document.documentElement.dataset['theme'] = dark ? 'light' : 'dark';
    this.dress();
    for (const plot of this.plots) plot.build();
    this.update();
  }

  private toggle(): void {
    this.player.toggle();
    this.frames.length = 0;
    this.update();
  }

  private update(): void {
    this.dirty = true;
    this.play.textContent = this.player.playing || this.player.following ? '❚❚' : '▶';
    this.now.setAttribute('aria-pressed', String(this.player.following));
    this.speed.value = String(this.player.speed);
  }

  private frame(now: number): void {
    const elapsed = Math.min(0.25, Math.max(0, now - this.last) / 1000);
    this.last = now;
    if (this.live !== undefined) this.grow(this.live, now);
    const was_playing = this.player.playing || (this.player.following && now - this.grown < kStill);
    if (this.player.advance(elapsed)) {
      this.dirty = true;
      this.frames.push(now);
      if (this.frames.length > 60) this.frames.shift();
    }
    if (this.dirty) {
      this.dirty = false;
      this.show();
      if (was_playing && !this.player.playing) this.update();
    }
    this.stage?.draw(was_playing ? elapsed : 0);
    requestAnimationFrame((next) => this.frame(next));
  }

  /// Takes the rows that came since the last frame.
  private grow({ recording }: Live, now: number): void {
    if (recording.taken === this.taken || recording.rows === 0) return;
    this.taken = recording.taken;
    this.grown = now;
    const [begin, end] = [recording.time[0]!, recording.time[recording.rows - 1]!];
    const was_following = this.player.following;
    this.player.grow(begin, end);
    this.range.grow(begin, end, was_following);
    this.slider.min = String(begin);
    this.slider.max = String(end);
    this.dirty = true;
    if (was_following) {
      this.frames.push(now);
      if (this.frames.length > 60) this.frames.shift();
    }
    if (now - this.refreshed < kRefresh) return;
    this.refreshed = now;
    for (const cue of this.cues) if (this.shown.has(cue.id)) cue.refresh?.();
    for (const plot of this.plots) plot.fold();
  }

  /// Brings everything to the present time.
  private show(): void {
    const { time: t, end, following } = this.player;
    this.slider.value = String(t);
    this.clock.textContent = this.live === undefined ? `${t.toFixed(3)} / ${end.toFixed(3)} s` : following ? `${t.toFixed(3)} s` : `${t.toFixed(3)} s, ${(end - t).toFixed(1)} s ago`;
    const { from, to } = this.range;
    this.range.reveal(t);
    const is_due = this.live === undefined ? from !== this.range.from || to !== this.range.to : this.last - this.redrawn >= kRedraw;
    if (is_due) {
      this.redrawn = this.last;
      for (const plot of this.plots) plot.draw();
    }
    if (is_due || this.live === undefined || !following) for (const plot of this.plots) plot.follow(t);
    const place = this.scenery.place(t);
    this.lights.update(place.row);
    if (this.stage === undefined) return;
    for (const view of this.figures) view.place(place, t);
    for (const view of this.bodies) if (view.moves) view.place(place);
    // Nobody reads figures that change 60 times a second, and laying them out takes longer than drawing the robot.
    const has_texts = !following || this.last - this.written >= kTexts;
    if (has_texts) this.written = this.last;
    for (const cue of this.cues) {
      if (!this.shown.has(cue.id)) continue;
      const lines = cue.update(place, t).join('\n');
      if (has_texts) this.entries.get(cue.id)!.text.textContent = lines;
    }
    this.stage.invalidate();
  }

  private listen(): void {
    // Space presses what was reached by Tab, but not again what was clicked.
    let by_tab = false;
    document.addEventListener('pointerdown', () => (by_tab = false), true);
    document.addEventListener('keydown', (event) => {
      by_tab ||= event.key === 'Tab';
      if (event.ctrlKey || event.altKey || event.metaKey || this.help.open) return;
      const target = event.target;
      if (target instanceof HTMLSelectElement) return;
      if (target instanceof HTMLElement && target.matches('button, summary, input[type=checkbox]')) {
        if (event.key === 'Enter' || (event.key === ' ' && by_tab)) return;
        if (event.key === ' ') target.blur();
      }
      // Texts and numbers are written, and the sliders of values move, with keys that would do something else.
      if (target instanceof HTMLInputElement && target !== this.slider) {
        if (['number', 'search'].includes(target.type)) return;
        if (target.type === 'range' && /^(Arrow|Home|End|Page)/.test(event.key)) return;
      }
      if (this.key(event.key, event.shiftKey)) event.preventDefault();
    });
  }

  /// What a key does. Returns whether it does anything.
  private key(key: string, shift: boolean): boolean {
    const row = this.recording.nearest(this.player.time);
    const step = (rows: number): void => {
      this.player.playing = false;
      if (shift) this.seek(this.player.time + (rows * (this.range.to - this.range.from)) / 50);
      else this.seek(this.recording.time[Math.min(Math.max(row + rows, 0), this.recording.rows - 1)] ?? 0);
    };
    const actions: Record<string, () => void> = {
      ' ': () => this.toggle(),
      ArrowLeft: () => step(-1),
      ArrowRight: () => step(1),
      Home: () => this.seek(this.player.begin),
      End: () => this.seek(this.player.end),
      '+': () => this.player.change_speed(1),
      '-': () => this.player.change_speed(-1),
      '[': () => this.range.zoom(0.5, this.player.time),
      ']': () => this.range.zoom(2, this.player.time),
      '0': () => {
        this.range.all();
        this.view_all();
      },
      d: () => this.change_theme(),
      '?': () => this.show_help(),
    };
    if (this.live !== undefined) {
      const { controls } = this.live;
      Object.assign(actions, { p: () => controls.toggle_pause(), '.': () => controls.make_steps(), End: () => this.follow() });
    }
    const action = actions[key];
    if (action !== undefined) {
      action();
      if (['[', ']', '0'].includes(key)) this.draw_plots();
      this.update();
      return true;
    }
    const cue = this.cues.find((candidate) => candidate.key === key);
    if (cue === undefined) return false;
    void this.switch_cue(cue, !this.shown.has(cue.id));
    return true;
  }
}

function fail(text: string): void {
  document.getElementById('app')!.replaceChildren(element('p', { class: 'failure' }, text));
}

/// What the gateway tells of its run; asks for a token until the gateway takes it.
async function facts_with_token(connection: Connection): Promise<RunFacts> {
  for (let is_first = true; ; is_first = false) {
    try {
      return await connection.ask<RunFacts>('GET', 'run');
    } catch (error) {
      if (!(error instanceof Refused) || error.status !== 401) throw error;
    }
    const field = element('input', { type: 'password', autocomplete: 'off', 'aria-label': 'token' });
    const form = element('form', { class: 'failure' }, element('p', {}, is_first ? 'This gateway expects a token.' : 'The gateway does not take this token.'), field, element('button', {}, 'open'));
    document.getElementById('app')!.replaceChildren(form);
    field.focus();
    await new Promise<void>((resolve) => {
      form.addEventListener('submit', (event) => {
        event.preventDefault();
        resolve();
      });
    });
    connection.use_token(field.value.trim());
    form.remove();
  }
}

/// The page of the run of the gateway that the page came from; undefined, with the gateway's own page, if it shows none.
async function live_page(): Promise<Page | undefined> {
  const connection = new Connection();
  const facts = await facts_with_token(connection);
  if (!facts.has_page) {
    await show_gateway(connection);
    return undefined;
  }
  const [data, { signals }] = await Promise.all([connection.ask<PageData>('GET', 'run/page'), connection.ask<{ signals: LiveSignal[] }>('GET', 'run/signals')]);
  let first = 0;
  const watched = signals
    .filter((signal) => signal.watchable && signal.size > 0)
    .map((signal) => {
      const { units, joints } = signal;
      const entry: Signal = { name: signal.name, unit: signal.unit ?? '', first, count: signal.size, ...(units && { units }), ...(joints && { joints }) };
      first += signal.size;
      return entry;
    });
  const recording = new LiveRecording(watched);
  recording.ordered = (names) => connection.order(names);
  connection.on_sample = (sample) => recording.take(sample);
  connection.state = facts;
  return new Page(data, recording, data.numbers ?? '', { connection, recording, controls: new Controls(connection, facts, signals, data.events ?? []) });
}

function recorded_page(text: string): Page {
  const data = JSON.parse(text) as PageData;
  const numbers = content_of('cotwin-numbers');
  return new Page(data, new Recording(data.tables[0]!, numbers), numbers, undefined, data.view && new Recording(data.view, numbers));
}

async function start(): Promise<void> {
  const text = content_of('cotwin-data');
  const is_live = document.getElementById('cotwin-live') !== null;
  if (text === '' && !is_live) return fail('This page has no recording in it. `cotwin view RESULTS` writes one that has.');
  if (typeof DecompressionStream === 'undefined') return fail('This browser cannot unpack the recording: it has no DecompressionStream. Browsers of 2023 and later have it.');
  const page = is_live ? await live_page() : recorded_page(text);
  await page?.open();
  Object.assign(window, { cotwin: page });
  document.documentElement.dataset['ready'] = 'true';
}

start().catch((error: unknown) => fail(`The page cannot be shown: ${error instanceof Error ? error.message : String(error)}`));
