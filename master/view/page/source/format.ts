/// The content of the page, as master/view writes it: JSON in the element #cotwin-data, and packed numbers as base64 in #cotwin-numbers.

/// A stream of numbers: deflated bytes (zlib) from byte `at` of the packed numbers on. `at` is a multiple of three, so that a stream begins with a
/// whole group of base64.
export interface Packed {
  at: number;
  size: number;
  count: number;
  /// steps: least + step · k; float: the bits of float32, mapped to integers in the order of the numbers; whole: integers below 2^53.
  kind: 'steps' | 'float' | 'whole';
  /// How often the integers were replaced by their differences: 0, 1 or 2.
  order: number;
  least?: number;
  step?: number;
  /// Of steps: what is not finite: from this element on, so many, and what: 0 NaN, 1 ∞, -1 -∞.
  gaps?: [number, number, number][];
}

/// A recorded variable. Its values are `count` columns of the table from `first` on.
export interface Signal {
  name: string;
  /// Of measure; "" where elements differ, which then have `units`.
  unit: string;
  units?: string[];
  /// Names of the elements.
  joints?: string[];
  first: number;
  count: number;
}

/// Units of measure of vectors in space; those along principal axes are none.
const kSpatial = ['m', 'm/s', 'm/s2', 'N', 'N.m', 'N/m', 'rad/s', 'rad/s2'];
const kPrincipal = /(^|\.)([KD]_[a-z]+|d?x|\w+_lengths)$/;

/// What an element of a signal is called: a joint, x y z of a vector, w x y z of a quaternion; otherwise its number, from 1 on.
export function element_name({ name, joints, unit, count }: Pick<Signal, 'name' | 'joints' | 'unit' | 'count'>, i: number): string {
  const is_spatial = kSpatial.includes(unit) || /(^|\.)(normal|u)$/.test(name);
  const point = /\.contact_[pf]$/.test(name) ? `${Math.floor(i / 3) + 1} ` : '';
  if (joints?.[i] !== undefined) return joints[i];
  if (count === 4 && /quat\w*$/.test(name)) return 'wxyz'[i]!;
  return (count === 3 && is_spatial && !kPrincipal.test(name)) || point !== '' ? point + 'xyz'[i % 3]! : `[${i + 1}]`;
}

/// Rows of numbers over time. `time` in ns.
export interface Table {
  rows: number;
  time: Packed;
  columns: Packed[];
  signals: Signal[];
}

export type Vector = [number, number, number];
/// (w, x, y, z)
export type Quaternion = [number, number, number, number];

export interface Pose {
  p: Vector;
  quat: Quaternion;
}

export interface Visual extends Pose {
  kind: 'box' | 'sphere' | 'cylinder' | 'capsule' | 'ellipsoid' | 'plane' | 'hull' | 'triangles' | 'mesh';
  /// box: edges; sphere: radius; cylinder, capsule: radius, length; ellipsoid: radii; mesh: scale.
  size: Vector;
  /// red, green, blue, opacity, each 0 to 1; absent: the page's choice.
  colour?: [number, number, number, number];
  /// hull: corners; triangles: three corners each. x, y, z of each.
  points?: Packed;
  /// mesh: index in PageData.meshes.
  mesh?: number;
}

/// The point cloud of a monitor. A point is at low + step · k in its frame; `points`: k, whole numbers from 0 to 65535, all x, then all y, then all z.
export interface Cloud extends Pose {
  name: string;
  low: Vector;
  step: Vector;
  /// Of a point in the picture, m.
  size: number;
  points: Packed;
}

export interface Mesh {
  name: string;
  format: 'stl' | 'obj' | 'dae' | 'gltf' | 'glb';
  at: number;
  size: number;
  count: number;
}

/// The joint that moves a body relative to its parent body (-1: the base): position = multiplier · q[leader] + offset.
export interface Joint extends Pose {
  name: string;
  type: 'revolute' | 'prismatic';
  parent: number;
  axis: Vector;
  leader: number;
  multiplier: number;
  offset: number;
  /// rad or m; null: none
  min: number | null;
  max: number | null;
}

export interface Frame extends Pose {
  name: string;
  body: number;
}

/// A robot. joints[i] moves body i; parents come first in `order`.
export interface Robot {
  name: string;
  n: number;
  joints: Joint[];
  order: number[];
  frames: Frame[];
  tip: number;
  /// Names of the independent joints.
  names: string[];
  /// Of the base, then of each body: what the URDF shows, and the shapes that touch others.
  visuals: Visual[][];
  solids: Visual[][];
  /// Of the bodies, in their axes; only where the page calculates with them. kg, m, kg m²; inertia: about the centre of mass, xx xy xz yy yz zz.
  inertias?: Inertia[];
  base_inertia?: Inertia;
}

/// Where a base is: at the start, and the signals of its motion, empty if they are not recorded.
export interface Base {
  base: Pose;
  base_p: string;
  base_quat: string;
}

/// What moves a figure: a signal with n elements; a track with a base is not at that of the figure.
export interface Track extends Partial<Base> {
  role: 'main' | 'desired' | 'compliant' | 'other';
  signal: string;
}

export interface Inertia {
  mass: number;
  com: Vector;
  inertia: number[];
}

/// Names of the signals of a cue, or what must be recorded for it.
export interface Source {
  signals: string[];
  lacks: string;
}

/// A tool on a robot, in the frame of the body that carries it (-1: the base), from a time on until another (null: to the end), s.
export interface Tool extends Pose {
  name: string;
  body: number;
  from: number;
  until: number | null;
  visuals: Visual[];
}

/// One robot on the stage.
export interface Figure extends Base {
  name: string;
  robot: number;
  q0: number[];
  tools: Tool[];
  tracks: Track[];
  tau_e: Source;
  /// Signals of the calculated table: Λ_v⁻¹ and J_v J_vᵀ of the tip in the base, xx xy xz yy yz zz; empty if they cannot be calculated.
  mobility: string;
  velocity: string;
  /// Stiffness of the tip in the base, in the same order.
  stiffness: Source;
  /// Of a live page: whether the base moves freely.
  floats?: boolean;
  /// Of a live page: where the stiffness comes from: joints (N m/rad, n) or the diagonal of a frame's (N/m, 3 or 9 with all elements).
  controller?: { signal: string; joints: boolean; in_tool: boolean };
}

export interface Body extends Pose {
  name: string;
  fixed: boolean;
  ghost: boolean;
  p_signal: string;
  quat_signal: string;
  visuals: Visual[];
  /// Of an obstacle of a monitor: whether it is there, and its size.
  obstacle?: { present: number; present_signal: string; scale: number; scale_signal: string };
}

export interface Contacts {
  p: string;
  f: string;
}

/// A force (N) at a point in the world, for example of a hand.
export interface Force {
  name: string;
  p: string;
  f: string;
  figure: number;
}

/// What a monitor measures: the nearest points (m, in the world) and their distance (m).
export interface Measured {
  name: string;
  p_a: string;
  p_b: string;
  distance: string;
  /// The robot in PageData.figures that is watched, -1: several; by how much its shapes are inflated, m.
  figure?: number;
  r?: number;
  /// The pair that counts for the separation of robots and people.
  apart?: { p_a: string; p_b: string; S_p: string; zone: string };
}

/// The last profile of a scanner: ranges (m, 0: nothing) of beams that are an angle apart (rad), in the plane of x and z on both sides of z alike.
export interface Profile {
  name: string;
  ranges: string;
  p: string;
  quat: string;
  increment: string;
}

/// The zone of a robot: 0 clear, 1 slow, 2 stop.
export interface Light {
  name: string;
  zone: string;
}

/// A term of the energy of a component.
export interface EnergyTerm {
  signal: string;
  kind: 'in' | 'stored' | 'lost';
  label: string;
}

/// A change of values that the scenario plans.
export interface PlannedEvent {
  time_s: number;
  name: string;
  values: number[];
  ramp_s: number;
}

/// `tables`: the recording and what was calculated from it. A live page has none; it has events, and its packed numbers beside the rest.
export interface PageData {
  format: number;
  name: string;
  state: string;
  facts: [string, string][];
  remarks: string[];
  tables: Table[];
  /// The largest number of the run in each unit of measure. Absent in pages of earlier versions and of runs that go on.
  scales?: Record<string, number>;
  /// What pages show of a run, beside what the user recorded.
  view?: Table;
  robots: Robot[];
  figures: Figure[];
  bodies: Body[];
  /// Absent in pages of earlier versions.
  clouds?: Cloud[];
  meshes: Mesh[];
  contacts: Contacts[];
  contacts_lack: string;
  forces: Force[];
  distances: Measured[];
  distances_lack: string;
  /// Absent in pages of earlier versions.
  profiles?: Profile[];
  profiles_lack?: string;
  lights: Light[];
  energy: EnergyTerm[];
  energy_lacks: string;
  plots: string[];
  events?: PlannedEvent[];
  numbers?: string;
}
