import * as three from 'three';
import type { Marks } from './clouds';
import { kCues, kRoles } from './colours';
import { Distances } from './distances';
import { element, round_down, short } from './dom';
import type { BodyView, FigureView, Shown } from './figures';
import type { PageData, Robot } from './format';
import type { Matrices } from './matrices';
import { matte } from './materials';
import { Profiles } from './profiles';
import { between, type Place, type Recording, type Scales } from './recording';
import { mass_along, principal_of, principal_of_product } from './symmetric';

/// What the cues draw from.
export interface Scenery {
  data: PageData;
  recording: Recording;
  /// What is calculated beside the signals; undefined if there is nothing.
  calculated: Matrices | undefined;
  figures: FigureView[];
  bodies: BodyView[];
  scene: three.Scene;
  /// Where the points of clouds are marked.
  marks: Marks;
  scales: Scales;
  /// The length of an arrow, at most, m.
  longest: () => number;
  /// Of the robot as cues draw it, m.
  size: (robot: Robot) => number;
}

/// Something that can be switched on in the 3D view. `lacks`: what must be recorded for it, empty if it can be shown.
export interface Cue {
  readonly id: string;
  readonly label: string;
  readonly key: string;
  readonly colour: string;
  readonly lacks: string;
  /// Signals to be unpacked before it is shown: of the recording and of the calculated table.
  readonly needs: string[];
  readonly calculates: string[];
  /// Called once, when the signals are there.
  build(): void;
  /// Chooses sizes again, and what follows from the whole recording: called now and then while the recording grows.
  refresh?(): void;
  show(on: boolean): void;
  /// Moves everything to the place in the recording at time t. Returns lines for people.
  update(place: Place, t: number): string[];
  /// Further content of its entry in the list.
  readonly content?: HTMLElement;
}

/// An arrow from a point along a vector.
class Arrow {
  readonly group = new three.Group();
  private readonly shaft: three.Mesh;
  private readonly head: three.Mesh;
  private static readonly kUp = new three.Vector3(0, 1, 0);
  private readonly direction = new three.Vector3();

  constructor(
    colour: string,
    private readonly thickness: number,
  ) {
    const material = matte({ color: colour });
    this.shaft = new three.Mesh(new three.CylinderGeometry(1, 1, 1, 12).translate(0, 0.5, 0), material);
    this.head = new three.Mesh(new three.ConeGeometry(1, 1, 16).translate(0, 0.5, 0), material);
    this.group.add(this.shaft, this.head);
  }
  /// Returns whether it is cut, because it is longer than `longest`.
  set(from: three.Vector3, along: three.Vector3, longest: number): boolean {
    const whole = along.length();
    const length = Math.min(whole, longest);
    this.group.visible = whole > 1e-9 && Number.isFinite(whole + from.length());
    if (!this.group.visible) return false;
    const thick = Math.min(this.thickness, 0.15 * length);
    const head = Math.min(4.2 * thick, 0.6 * length);
    this.group.position.copy(from);
    this.group.quaternion.setFromUnitVectors(Arrow.kUp, this.direction.copy(along).normalize());
    this.shaft.scale.set(thick, length - head, thick);
    this.head.position.set(0, length - head, 0);
    this.head.scale.set(2.3 * thick, head, 2.3 * thick);
    return whole > longest;
  }
}

/// An ellipsoid, transparent, with its three half-axes.
class Ellipsoid {
  readonly group = new three.Group();
  constructor(colour: string) {
    const material = matte({ color: colour, transparent: true, opacity: 0.33, depthWrite: false });
    const ends = [0, 1, 2].flatMap((axis) => [-1, 1].map((end) => new three.Vector3().setComponent(axis, end)));
    const lines = new three.LineSegments(new three.BufferGeometry().setFromPoints(ends), new three.LineBasicMaterial({ color: colour }));
    this.group.add(new three.Mesh(new three.SphereGeometry(1, 28, 18), material), lines);
    this.group.matrixAutoUpdate = false;
  }
  /// `axes`: in the axes of `base`; `lengths`: of the half-axes, m, may be infinite. Returns whether it is cut, because it is longer than `longest`.
  set(centre: three.Vector3, base: three.Matrix4, axes: [number, number, number][], lengths: number[], longest: number): boolean {
    this.group.visible = lengths.every((length) => length >= 0);
    if (!this.group.visible) return false;
    const columns = axes.map((axis, i) => new three.Vector3(...axis).transformDirection(base).multiplyScalar(Math.min(Math.max(lengths[i]!, 1e-4), longest)));
    this.group.matrix.makeBasis(columns[0]!, columns[1]!, columns[2]!).setPosition(centre);
    this.group.matrixWorldNeedsUpdate = true;
    return lengths.some((length) => length > longest);
  }
}
const shorter = (...cuts: boolean[]): string => (cuts.includes(true) ? ', drawn shorter' : '');

/// The value that 95 % of the numbers do not exceed; 1 if there is none above 0.
export function usual_largest(values: Iterable<number>): number {
  const sorted = [...values].filter((x) => Number.isFinite(x) && x > 0).sort((a, b) => a - b);
  return sorted[Math.floor(0.95 * (sorted.length - 1))] ?? 1;
}

const several = (figures: FigureView[], figure: FigureView): string => (figures.length > 1 ? `${figure.figure.name}: ` : '');

/// Other positions of the same robot: desired, compliant, measured; what is around a robot of another world.
class Ghosts implements Cue {
  readonly id = 'ghosts';
  readonly label = 'ghosts';
  readonly key = 'g';
  readonly colour = kRoles.desired;
  readonly lacks: string;
  readonly needs: string[] = [];
  readonly calculates: string[] = [];
  constructor(private readonly s: Scenery) {
    const any = s.figures.some((figure) => figure.ghosts.length > 0);
    this.lacks = any ? '' : 'record further joint positions of the robot, for example motion.q_d (desired), compliance.q_c (compliant) or those of the real robot';
  }
  build(): void {}
  show(on: boolean): void {
    for (const figure of this.s.figures) for (const ghost of figure.ghosts) ghost.group.visible = on;
    for (const view of this.s.bodies) if (view.body.ghost) view.group.visible = on;
  }
  /// The ghosts that are shown follow with their figures.
  update(): string[] {
    const words = { main: '', desired: 'desired', compliant: 'compliant', other: 'beside' };
    return this.s.figures.flatMap((figure) => figure.ghosts.map((ghost) => `${words[ghost.track.role]}: ${ghost.track.signal}`));
  }
}

/// The way of the tips.
class Trails implements Cue {
  readonly id = 'trails';
  readonly label = 'trails of the tip';
  readonly key = 't';
  readonly colour = kRoles.main;
  readonly lacks: string;
  readonly needs: string[] = [];
  readonly calculates: string[] = [];
  private readonly group = new three.Group();
  constructor(private readonly s: Scenery) {
    this.lacks = s.figures.some((figure) => figure.figure.tracks.length > 0) ? '' : 'record the joint positions of a robot, for example drive.q';
  }
  build(): void {
    this.draw(3000);
    this.s.scene.add(this.group);
  }
  refresh(): void {
    for (const line of this.group.children) (line as three.Line).geometry.dispose();
    this.group.clear();
    this.draw(600);
  }
  private draw(most: number): void {
    for (const figure of this.s.figures) {
      for (const shown of [figure.main, ...figure.ghosts] as Shown[]) {
        const points = figure.trail(shown, this.s.recording, most);
        if (points.some((x) => !Number.isFinite(x))) continue;
        const geometry = new three.BufferGeometry().setAttribute('position', new three.BufferAttribute(points, 3));
        this.group.add(new three.Line(geometry, new three.LineBasicMaterial({ color: kRoles[shown.track.role] })));
      }
    }
  }
  show(on: boolean): void {
    this.group.visible = on;
  }
  update(): string[] {
    return this.s.figures.map((figure) => `${several(this.s.figures, figure)}of ${figure.robot.frames[figure.robot.tip]?.name ?? 'the tip'}`);
  }
}

/// Forces at contact points, or of a hand.
class Forces implements Cue {
  readonly needs: string[];
  readonly calculates: string[] = [];
  private readonly group = new three.Group();
  private readonly arrows: { arrow: Arrow; p: string; f: string; k: number; figure: number }[] = [];
  private scale = 1;
  private text = '';
  constructor(
    private readonly s: Scenery,
    readonly id: string,
    readonly label: string,
    readonly key: string,
    readonly colour: string,
    readonly lacks: string,
    private readonly sources: { p: string; f: string; figure: number }[],
    private readonly size: number,
  ) {
    this.needs = sources.flatMap((source) => [source.p, source.f]);
  }
  build(): void {
    for (const source of this.sources) {
      const p = this.s.recording.values(source.p);
      const f = this.s.recording.values(source.f);
      if (p === undefined || f === undefined) continue;
      for (let k = 0; 3 * k + 2 < Math.min(p.length, f.length); ++k) {
        const arrow = new Arrow(this.colour, 0.012 * this.size);
        this.arrows.push({ arrow, p: source.p, f: source.f, k, figure: source.figure });
        this.group.add(arrow.group);
      }
    }
    this.refresh();
    this.s.scene.add(this.group);
  }
  refresh(): void {
    const magnitudes: number[] = [];
    for (const source of this.sources) {
      const f = this.s.recording.values(source.f);
      for (let k = 0; f !== undefined && 3 * k + 2 < f.length; ++k) {
        const stride = Math.max(1, Math.floor(this.s.recording.rows / 5000));
        for (let i = 0; i < this.s.recording.rows; i += stride) magnitudes.push(Math.hypot(f[3 * k]![i]!, f[3 * k + 1]![i]!, f[3 * k + 2]![i]!));
      }
    }
    const newtons = Math.max(usual_largest(magnitudes), this.s.scales.least('N'));
    this.scale = (0.35 * this.size) / newtons;
    const unit = round_down(newtons);
    this.text = `${short(unit)} N: ${short(unit * this.scale)} m`;
  }
  show(on: boolean): void {
    this.group.visible = on;
  }
  update(place: Place): string[] {
    let [count, cut, largest] = [0, 0, 0];
    for (const { arrow, p, f, k, figure } of this.arrows) {
      const vector = (name: string): three.Vector3 => {
        const columns = this.s.recording.values(name)!;
        // Contact points come and go, so they are not interpolated.
        return new three.Vector3(columns[3 * k]![place.row], columns[3 * k + 1]![place.row], columns[3 * k + 2]![place.row]);
      };
      const force = vector(f);
      const at = vector(p);
      const view = this.s.figures[figure];
      if (view !== undefined) {
        at.applyMatrix4(view.base);
        const size = force.length();
        force.transformDirection(view.base).multiplyScalar(size);
      }
      if (force.length() > this.s.scales.least('N')) ++count;
      largest = Math.max(largest, force.length() || 0);
      if (arrow.set(at, force.multiplyScalar(this.scale), this.s.longest())) ++cut;
    }
    return [`${count} of ${this.arrows.length}, largest ${this.s.scales.text(largest, 'N')} N`, `${this.text}${shorter(cut > 0)}`];
  }
}

const effort_unit = (figure: FigureView, joint: number): string => (figure.robot.joints[joint]?.type === 'prismatic' ? 'N' : 'N.m');

/// External torques as rings about the axes of the joints.
class Torques implements Cue {
  readonly id = 'tau_e';
  readonly label = 'external joint torques τ_e';
  readonly key = 'e';
  readonly colour = kCues.torque;
  readonly lacks: string;
  readonly needs: string[];
  readonly calculates: string[] = [];
  private readonly group = new three.Group();
  private readonly rings: { figure: FigureView; joint: number; ring: three.Mesh; radius: number; drawn: number }[] = [];
  /// Of torques (N·m) and of forces of slides (N), which are never compared.
  private largest = new Map<string, number>();
  constructor(private readonly s: Scenery) {
    this.needs = s.figures.flatMap((figure) => figure.figure.tau_e.signals);
    this.lacks = this.needs.length > 0 ? '' : (s.figures[0]?.figure.tau_e.lacks ?? 'there is no robot');
  }
  build(): void {
    const material = matte({ color: this.colour, side: three.DoubleSide });
    for (const figure of this.s.figures) {
      const name = figure.figure.tau_e.signals[0];
      if (name === undefined || this.s.recording.values(name) === undefined) continue;
      for (let joint = 0; joint < figure.robot.n; ++joint) {
        const ring = new three.Mesh(new three.BufferGeometry(), material);
        ring.matrixAutoUpdate = false;
        this.rings.push({ figure, joint, ring, radius: 0.085 * this.s.size(figure.robot), drawn: NaN });
        this.group.add(ring);
      }
    }
    this.refresh();
    this.s.scene.add(this.group);
  }
  refresh(): void {
    const magnitudes = new Map<string, number[]>();
    for (const figure of this.s.figures) {
      const columns = this.s.recording.values(figure.figure.tau_e.signals[0] ?? '') ?? [];
      const stride = Math.max(1, Math.floor(this.s.recording.rows / 5000));
      columns.forEach((column, joint) => {
        const unit = effort_unit(figure, joint);
        const list = magnitudes.get(unit) ?? [];
        for (let i = 0; i < this.s.recording.rows; i += stride) list.push(Math.abs(column[i]!));
        magnitudes.set(unit, list);
      });
    }
    for (const [unit, list] of magnitudes) this.largest.set(unit, Math.max(usual_largest(list), this.s.scales.least(unit)));
  }
  show(on: boolean): void {
    this.group.visible = on;
  }
  update(place: Place): string[] {
    const lines: string[] = [`${[...this.largest].map(([unit, most]) => `${short(most)} ${unit.replace('.', '·')}`).join(', ')}: three quarters of a turn`];
    for (const entry of this.rings) {
      const { figure, joint, ring, radius } = entry;
      const columns = this.s.recording.values(figure.figure.tau_e.signals[0]!)!;
      const column = columns[joint];
      const torque = column === undefined ? NaN : between(column, place);
      const unit = effort_unit(figure, joint);
      if (joint === 0) {
        for (const kind of new Set(columns.map((_, i) => effort_unit(figure, i)))) {
          const own = columns.filter((_, i) => effort_unit(figure, i) === kind);
          lines.push(`${several(this.s.figures, figure)}${own.map((values) => this.s.scales.text(between(values, place), kind)).join('  ')} ${kind.replace('.', '·')}`);
        }
      }
      const turn = Math.min(1.95, Math.max(-1.95, (1.5 * torque) / (this.largest.get(unit) ?? 1))) * Math.PI;
      ring.visible = Math.abs(turn) > 0.02;
      if (!ring.visible) continue;
      const rounded = Math.round(turn * 50) / 50;
      if (rounded !== entry.drawn) {
        ring.geometry.dispose();
        ring.geometry = new three.TorusGeometry(radius, 0.12 * radius, 8, Math.max(4, Math.ceil(Math.abs(turn) * 8)), Math.abs(turn));
        if (turn < 0) ring.geometry.rotateX(Math.PI);
        entry.drawn = rounded;
      }
      const axis = new three.Vector3(...figure.robot.joints[joint]!.axis);
      ring.matrix
        .makeRotationFromQuaternion(new three.Quaternion().setFromUnitVectors(new three.Vector3(0, 0, 1), axis))
        .premultiply(figure.main.poses[joint]!)
        .premultiply(figure.base);
      ring.matrixWorldNeedsUpdate = true;
    }
    return lines;
  }
}

/// Effective mass of the tip: an arrow along its motion, and the ellipsoid of the masses along the principal directions.
class EffectiveMass implements Cue {
  readonly id = 'mass';
  readonly label = 'effective mass';
  readonly key = 'm';
  readonly colour = kCues.mass;
  readonly lacks: string;
  readonly needs: string[] = [];
  readonly calculates: string[];
  private readonly group = new three.Group();
  private readonly parts: { figure: FigureView; ellipsoid: Ellipsoid; arrow: Arrow; direction: three.Vector3; scale: number }[] = [];
  constructor(private readonly s: Scenery) {
    this.calculates = s.figures.map((figure) => figure.figure.mobility).filter((name) => name !== '');
    this.lacks = this.calculates.length > 0 ? '' : 'record the joint positions of a robot whose URDF has masses, for example drive.q';
  }
  build(): void {
    for (const figure of this.s.figures) {
      if (figure.figure.mobility === '') continue;
      const part = { figure, ellipsoid: new Ellipsoid(this.colour), arrow: new Arrow(this.colour, 0.012 * this.s.size(figure.robot)), direction: new three.Vector3(0, 0, 1), scale: 1 };
      this.parts.push(part);
      this.group.add(part.ellipsoid.group, part.arrow.group);
    }
    this.refresh();
    this.s.scene.add(this.group);
  }
  refresh(): void {
    for (const part of this.parts) {
      const masses = this.s.calculated!.some(part.figure.figure.mobility, 500).map((matrix) => 1 / principal_of_product(matrix).values[1]);
      part.scale = (0.16 * this.s.size(part.figure.robot)) / usual_largest(masses);
    }
  }
  show(on: boolean): void {
    this.group.visible = on;
  }
  update(place: Place, t: number): string[] {
    return this.parts.flatMap((part) => {
      const { figure, scale } = part;
      const longest = this.s.longest();
      const mobility = this.s.calculated!.at(figure.figure.mobility, t);
      if (mobility === undefined) return [];
      const { values, axes } = principal_of_product(mobility);
      const centre = new three.Vector3().setFromMatrixPosition(figure.frame(figure.robot.tip));
      const body = part.ellipsoid.set(centre, figure.base, axes, values.map((value) => scale / Math.max(value, 1e-12)), longest);
      const u = this.motion(part.figure, place, part.direction);
      const mass = mass_along(mobility, u.toArray());
      const world = u.clone().transformDirection(figure.base);
      const arrow = part.arrow.set(centre, world.clone().multiplyScalar(Math.min(scale * mass, 2 * longest)), longest);
      const unit = round_down((0.16 * this.s.size(figure.robot)) / scale);
      return [
        `${several(this.s.figures, figure)}${short(mass)} kg along ${world.toArray().map((x, i) => `${'xyz'[i]}\u00a0${x.toFixed(2)}`).join(', ')}${shorter(arrow)}`,
        `principal: ${values.map((value) => short(value > 0 ? 1 / value : Infinity)).reverse().join('  ')} kg${shorter(body)}; ${short(unit)} kg: ${short(unit * scale)} m`,
      ];
    });
  }
  /// Direction of the tip's motion in the base; where it rests, the last one.
  private motion(figure: FigureView, place: Place, last: three.Vector3): three.Vector3 {
    const columns = this.s.recording.values(figure.main.track.signal);
    if (columns === undefined) return last;
    const at = (row: number): three.Vector3 => {
      const poses = figure.main.mechanism.bodies();
      figure.main.mechanism.place(figure.main.q.map((q, i) => (Number.isFinite(columns[i]?.[row]) ? columns[i]![row]! : q)), poses);
      const { body, p } = figure.robot.frames[figure.robot.tip]!;
      const tip = new three.Vector3(...p);
      return body >= 0 ? tip.applyMatrix4(poses[body]!) : tip;
    };
    const before = place.next === place.row ? Math.max(0, place.row - 1) : place.row;
    const way = at(place.next).sub(at(before));
    const time = this.s.recording.time[place.next]! - this.s.recording.time[before]!;
    if (time > 0 && way.length() / time > 1e-3) last.copy(way.normalize());
    return last;
  }
}

/// Velocities of the tip for joint speeds of norm one.
class Manipulability implements Cue {
  readonly id = 'manipulability';
  readonly label = 'manipulability';
  readonly key = 'v';
  readonly colour = kCues.velocity;
  readonly lacks: string;
  readonly needs: string[] = [];
  readonly calculates: string[];
  private readonly group = new three.Group();
  private readonly parts: { figure: FigureView; ellipsoid: Ellipsoid; scale: number }[] = [];
  constructor(private readonly s: Scenery) {
    this.calculates = s.figures.map((figure) => figure.figure.velocity).filter((name) => name !== '');
    this.lacks = this.calculates.length > 0 ? '' : 'record the joint positions of a robot, for example drive.q';
  }
  build(): void {
    for (const figure of this.s.figures) {
      if (figure.figure.velocity === '') continue;
      const part = { figure, ellipsoid: new Ellipsoid(this.colour), scale: 0.22 };
      this.parts.push(part);
      this.group.add(part.ellipsoid.group);
    }
    this.s.scene.add(this.group);
  }
  show(on: boolean): void {
    this.group.visible = on;
  }
  update(_: Place, t: number): string[] {
    return this.parts.flatMap(({ figure, ellipsoid, scale }) => {
      const velocity = this.s.calculated!.at(figure.figure.velocity, t);
      if (velocity === undefined) return [];
      const { values, axes } = principal_of_product(velocity);
      const lengths = values.map((value) => Math.sqrt(Math.max(0, value)));
      const is_cut = ellipsoid.set(new three.Vector3().setFromMatrixPosition(figure.frame(figure.robot.tip)), figure.base, axes, lengths.map((length) => length * scale), this.s.longest());
      return [`${several(this.s.figures, figure)}volume ${short(lengths[0]! * lengths[1]! * lengths[2]!)} m³/s³${lengths[2] === 0 ? ' (singular)' : ''}, half-axes ${lengths.map((length) => short(length)).join('  ')} m/s${shorter(is_cut)}`, `1 m/s: ${scale} m`];
    });
  }
}

/// Stiffness of the tip.
class Stiffness implements Cue {
  readonly id = 'stiffness';
  readonly label = 'stiffness of the tip';
  readonly key = 's';
  readonly colour = kCues.stiffness;
  readonly lacks: string;
  readonly needs: string[] = [];
  readonly calculates: string[];
  private readonly group = new three.Group();
  private readonly parts: { figure: FigureView; ellipsoid: Ellipsoid; scale: number }[] = [];
  constructor(private readonly s: Scenery) {
    this.calculates = s.figures.flatMap((figure) => figure.figure.stiffness.signals);
    this.lacks = this.calculates.length > 0 ? '' : (s.figures[0]?.figure.stiffness.lacks ?? 'there is no robot');
  }
  build(): void {
    for (const figure of this.s.figures) {
      if (figure.figure.stiffness.signals.length === 0) continue;
      const part = { figure, ellipsoid: new Ellipsoid(this.colour), scale: 1 };
      this.parts.push(part);
      this.group.add(part.ellipsoid.group);
    }
    this.refresh();
    this.s.scene.add(this.group);
  }
  refresh(): void {
    for (const part of this.parts) {
      const middle = this.s.calculated!.some(part.figure.figure.stiffness.signals[0]!, 500).map((matrix) => principal_of(matrix).values[1]);
      part.scale = (0.16 * this.s.size(part.figure.robot)) / usual_largest(middle);
    }
  }
  show(on: boolean): void {
    this.group.visible = on;
  }
  update(_: Place, t: number): string[] {
    return this.parts.flatMap(({ figure, ellipsoid, scale }) => {
      const stiffness = this.s.calculated!.at(figure.figure.stiffness.signals[0]!, t);
      if (stiffness === undefined) return [];
      const { values, axes } = principal_of(stiffness);
      const is_cut = ellipsoid.set(new three.Vector3().setFromMatrixPosition(figure.frame(figure.robot.tip)), figure.base, axes, values.map((value) => scale * Math.max(value, 0)), this.s.longest());
      const unit = round_down((0.16 * this.s.size(figure.robot)) / scale);
      return [`${several(this.s.figures, figure)}${values.map((value) => short(value)).join('  ')} N/m${shorter(is_cut)}`, `${short(unit)} N/m: ${short(unit * scale)} m`];
    });
  }
}

/// A bar from low to high with a filled part.
class Bar {
  readonly box: HTMLElement;
  private readonly fill = element('div', { class: 'fill' });
  private readonly number = element('div', { class: 'number' });
  constructor(name: string) {
    this.box = element('div', { class: 'bar' }, element('div', { class: 'name', title: name }, name), element('div', { class: 'rail' }, this.fill), this.number);
  }
  /// `from`, `to`: shares of the rail.
  set(from: number, to: number, colour: string, text: string): void {
    const [a, b] = [Math.min(from, to), Math.max(from, to)].map((x) => Math.min(Math.max(x, 0), 1)) as [number, number];
    this.fill.style.left = `${100 * a}%`;
    this.fill.style.width = `${100 * Math.max(b - a, 0.02)}%`;
    this.fill.style.background = colour;
    this.number.textContent = text;
  }
}

/// Where each joint is between its limits.
class Limits implements Cue {
  readonly id = 'limits';
  readonly label = 'joint limits';
  readonly key = 'l';
  readonly colour = kRoles.main;
  readonly lacks: string;
  readonly needs: string[] = [];
  readonly calculates: string[] = [];
  readonly content = element('div', { class: 'bars' });
  private readonly bars: { figure: FigureView; joint: number; bar: Bar }[] = [];
  constructor(private readonly s: Scenery) {
    const limited = s.figures.some((figure) => figure.figure.tracks.length > 0 && figure.robot.joints.some((joint) => joint.min !== null && joint.max !== null));
    this.lacks = limited ? '' : 'record the joint positions of a robot whose URDF has limits, for example drive.q';
  }
  build(): void {
    for (const figure of this.s.figures) {
      for (let joint = 0; joint < figure.robot.n; ++joint) {
        const bar = new Bar(`${several(this.s.figures, figure)}${figure.robot.names[joint]}`);
        this.bars.push({ figure, joint, bar });
        this.content.append(bar.box);
      }
    }
  }
  show(on: boolean): void {
    this.content.hidden = !on;
  }
  update(): string[] {
    for (const { figure, joint, bar } of this.bars) {
      const { min, max, type } = figure.robot.joints[joint]!;
      const q = figure.main.q[joint]!;
      const text = type === 'revolute' ? `${((q * 180) / Math.PI).toFixed(1)}°` : `${this.s.scales.text(q, 'm')} m`;
      if (min === null || max === null) {
        bar.set(0, 0, 'transparent', `${text} free`);
        continue;
      }
      const share = (q - min) / (max - min);
      const near = Math.min(share, 1 - share);
      bar.set(0.5, share, near < 0.05 ? kCues.contact : 'var(--accent)', near < 0 ? `${text} beyond` : near < 0.05 ? `${text} near` : text);
    }
    return [];
  }
}

/// Energy that came in, is stored and was lost.
class Energy implements Cue {
  readonly id = 'energy';
  readonly label = 'energy flow';
  readonly key = 'n';
  readonly colour = kCues.hand;
  readonly lacks: string;
  readonly needs: string[];
  readonly calculates: string[] = [];
  readonly content = element('div', { class: 'bars' });
  private readonly bars: { signal: string; kind: 'in' | 'stored' | 'lost'; bar: Bar }[] = [];
  private largest = 1;
  constructor(private readonly s: Scenery) {
    this.needs = s.data.energy.map((term) => term.signal);
    this.lacks = s.data.energy.length > 0 ? '' : s.data.energy_lacks;
  }
  build(): void {
    const words = { in: '→ ', stored: '= ', lost: '✕ ' };
    for (const term of this.s.data.energy) {
      const bar = new Bar(words[term.kind] + term.label);
      bar.box.title = term.signal;
      this.bars.push({ signal: term.signal, kind: term.kind, bar });
      this.content.append(bar.box);
    }
    this.refresh();
  }
  refresh(): void {
    for (const term of this.s.data.energy) {
      const column = this.s.recording.values(term.signal)?.[0];
      for (let i = 0; i < this.s.recording.rows; ++i) if (Number.isFinite(column?.[i])) this.largest = Math.max(this.largest, Math.abs(column![i]!));
    }
  }
  show(on: boolean): void {
    this.content.hidden = !on;
  }
  update(place: Place): string[] {
    const colours = { in: kCues.velocity, stored: kCues.stiffness, lost: kCues.contact };
    for (const { signal, kind, bar } of this.bars) {
      const columns = this.s.recording.values(signal)!;
      const joules = columns.reduce((sum, column) => sum + between(column, place), 0);
      bar.set(0.5, 0.5 + (0.5 * joules) / this.largest, colours[kind], `${this.s.scales.text(joules, 'J')} J`);
    }
    return ['→ came in, = stored, ✕ lost since the start'];
  }
}

/// All cues of a page, in the order of the list.
export function cues_of(s: Scenery, size: number): Cue[] {
  const all = s.data.contacts.map((contact) => ({ ...contact, figure: -1 }));
  return [
    new Ghosts(s),
    new Trails(s),
    new EffectiveMass(s),
    new Manipulability(s),
    new Stiffness(s),
    new Torques(s),
    new Forces(s, 'contacts', 'contact forces', 'c', kCues.contact, all.length > 0 ? '' : s.data.contacts_lack, all, size),
    new Forces(s, 'hand', 'forces of hands', 'h', kCues.hand, s.data.forces.length > 0 ? '' : 'record f and p of a unit operator_hand, for example hand.f and hand.p', s.data.forces, size),
    new Distances(s, size),
    new Profiles(s, size),
    new Limits(s),
    new Energy(s),
  ];
}
