import * as three from 'three';
import { kCues, kRoles } from './colours';
import { visible_box } from './framing';
import { Instances, type Member } from './instances';
import type { Base, Body, Figure, PageData, Robot, Tool, Track, Visual } from './format';
import { Mechanism, frame_pose, matrix_of } from './kinematics';
import { matte } from './materials';
import type { Column } from './packed';
import { between, type Place, type Recording } from './recording';
import { clean_shapes, looks_of, visual_object, type Meshes } from './shapes';

/// Poses of a frame that is recorded as position and quaternion (w, x, y, z); where there are none, the given one.
export class RecordedPose {
  private readonly fallback: three.Matrix4;
  private readonly a = new three.Quaternion();
  private readonly b = new three.Quaternion();
  private readonly p = new three.Vector3();

  constructor(
    pose: { p: [number, number, number]; quat: [number, number, number, number] },
    private readonly recording: Recording,
    private readonly p_signal: string,
    private readonly quat_signal: string,
  ) {
    this.fallback = matrix_of(pose);
  }

  /// Whether anything of it is recorded.
  get moves(): boolean {
    return this.recording.signal(this.p_signal) !== undefined || this.recording.signal(this.quat_signal) !== undefined;
  }

  at(place: Place, matrix: three.Matrix4): void {
    matrix.copy(this.fallback);
    const p = this.recording.values(this.p_signal);
    const quat = this.recording.values(this.quat_signal);
    if (quat?.length === 4) {
      const [w, x, y, z] = quat as [Column, Column, Column, Column];
      this.a.set(x[place.row]!, y[place.row]!, z[place.row]!, w[place.row]!);
      this.b.set(x[place.next]!, y[place.next]!, z[place.next]!, w[place.next]!);
      const length = this.a.length();
      if (length > 0.5 && length < 2) {
        this.a.normalize();
        if (place.share > 0 && Number.isFinite(this.b.length())) this.a.slerp(this.b.normalize(), place.share);
        this.p.setFromMatrixPosition(matrix);
        matrix.makeRotationFromQuaternion(this.a).setPosition(this.p);
      }
    }
    if (p?.length === 3) {
      this.p.set(between(p[0]!, place), between(p[1]!, place), between(p[2]!, place));
      if (Number.isFinite(this.p.x + this.p.y + this.p.z)) matrix.setPosition(this.p);
    }
  }
}

const base_pose_of = (at: Base, recording: Recording): RecordedPose => new RecordedPose(at.base, recording, at.base_p, at.base_quat);

/// A robot that follows one signal.
export class Shown {
  readonly group = new three.Group();
  readonly poses: three.Matrix4[];
  readonly q: number[];
  private readonly own_base: RecordedPose | undefined;
  private readonly parts: three.Group[] = [];

  constructor(
    readonly mechanism: Mechanism,
    readonly track: Track,
    start: number[],
    visuals: three.Group[],
    private readonly recording: Recording,
  ) {
    this.poses = mechanism.bodies();
    this.own_base = track.base === undefined ? undefined : base_pose_of(track as Base, recording);
    this.q = Array.from({ length: mechanism.robot.n }, (_, i) => start[i] ?? 0);
    for (const part of visuals) {
      part.matrixAutoUpdate = false;
      this.parts.push(part);
      this.group.add(part);
    }
    this.group.matrixAutoUpdate = false;
  }

  /// Where its base is; that of the figure unless it has its own.
  base(place: Place, of_figure: three.Matrix4, matrix: three.Matrix4): void {
    if (this.own_base === undefined) matrix.copy(of_figure);
    else this.own_base.at(place, matrix);
  }

  /// Positions that are not finite leave the joint where it is.
  place(place: Place, base: three.Matrix4): void {
    const columns = this.recording.values(this.track.signal);
    columns?.forEach((column, i) => {
      const value = between(column, place);
      if (Number.isFinite(value) && i < this.q.length) this.q[i] = value;
    });
    this.mechanism.place(this.q, this.poses);
    this.base(place, base, this.group.matrix);
    this.parts.forEach((part, i) => {
      if (i > 0) part.matrix.copy(this.poses[i - 1]!);
    });
    this.group.matrixWorldNeedsUpdate = true;
  }
}

/// A robot on the stage with its ghosts.
export class FigureView {
  readonly base = new three.Matrix4();
  readonly main: Shown;
  readonly ghosts: Shown[] = [];
  readonly group = new three.Group();
  private readonly base_pose: RecordedPose;
  private readonly tools: { tool: Tool; group: three.Group }[];
  private readonly bodies: three.Group[];

  constructor(
    readonly figure: Figure,
    readonly robot: Robot,
    recording: Recording,
    points: (visual: object) => Float32Array | undefined,
    meshes: Meshes,
  ) {
    const mechanism = new Mechanism(robot);
    this.base_pose = base_pose_of(figure, recording);
    const dressed = (track: Track): three.Group[] => {
      const ghost = track.role !== 'main';
      const looks = looks_of(kRoles[track.role], ghost ? 0.3 : 1);
      const objects = (visuals: Visual[][], material = (_: number): three.Material => looks.body): three.Group[] =>
        visuals.map((list, i) => {
          const group = new three.Group();
          for (const visual of list) {
            const object = visual_object(visual, points(visual), meshes, material(i), ghost);
            if (object !== undefined) group.add(object);
          }
          return group;
        });
      const filled = (groups: three.Group[]): number => groups.filter((group) => group.children.length > 0).length;
      const most = robot.joints.length / 2;
      const visuals = objects(robot.visuals);
      if (filled(visuals) > most) return visuals;
      const solids = objects(robot.solids, (i) => (i === 0 ? looks.base : looks.links[i % looks.links.length]!));
      if (filled(solids) > most) return solids;
      // A few shapes are those of a tool: they are added to the clean shape.
      const groups = clean_shapes(robot, looks);
      (filled(visuals) > 0 ? visuals : solids).forEach((group, i) => groups[i]!.add(group));
      return groups;
    };
    const none: Track = { role: 'main', signal: '' };
    const main = figure.tracks.find((track) => track.role === 'main') ?? none;
    const bodies = dressed(main);
    this.bodies = bodies;
    this.main = new Shown(mechanism, main, figure.q0, bodies, recording);
    this.group.add(this.main.group);
    const metal = matte({ color: '#5c8f6b' });
    this.tools = figure.tools.map((tool) => {
      const group = new three.Group();
      for (const visual of tool.visuals) {
        const object = visual_object(visual, points(visual), meshes, metal, false);
        if (object !== undefined) group.add(object);
      }
      matrix_of(tool).decompose(group.position, group.quaternion, group.scale);
      bodies[tool.body + 1]!.add(group);
      return { tool, group };
    });
    for (const track of figure.tracks) {
      if (track === main) continue;
      const ghost = new Shown(mechanism, track, figure.q0, dressed(track), recording);
      ghost.group.visible = false;
      this.ghosts.push(ghost);
      this.group.add(ghost.group);
    }
  }

  /// Translucent solids around the links, larger by r, m. Hulls of corners and meshes have none.
  veil(r: number): three.Object3D[] {
    const material = matte({ color: kCues.distance, transparent: true, opacity: 0.13, depthWrite: false });
    const more = { sphere: [1, 0, 0], capsule: [1, 0, 0], cylinder: [1, 2, 0], ellipsoid: [1, 1, 1], box: [2, 2, 2] } as const;
    return this.robot.solids.flatMap((list, i) =>
      list.flatMap((visual) => {
        if (!(visual.kind in more)) return [];
        const by = more[visual.kind as keyof typeof more];
        const larger: Visual = { ...visual, size: [0, 1, 2].map((k) => visual.size[k]! + r * by[k]!) as Visual['size'] };
        const object = visual_object(larger, undefined, [], material, true);
        if (object === undefined) return [];
        this.bodies[i]!.add(object);
        return [object];
      }),
    );
  }
  /// `t`: the time of the place, s.
  place(place: Place, t: number): void {
    this.base_pose.at(place, this.base);
    this.main.place(place, this.base);
    for (const { tool, group } of this.tools) group.visible = t >= tool.from && t < (tool.until ?? Infinity);
    for (const ghost of this.ghosts) {
      if (ghost.group.visible) ghost.place(place, this.base);
    }
  }

  tool_pose(name: string): number[] | null {
    const shown = this.tools.find(({ tool, group }) => tool.name === name && group.visible);
    if (shown === undefined) return null;
    shown.group.updateWorldMatrix(true, false);
    return shown.group.matrixWorld.toArray();
  }

  /// The pose of a frame in the world.
  frame(index: number): three.Matrix4 {
    return frame_pose(this.robot, index, this.main.poses).premultiply(this.base);
  }

  /// Positions of the tip in the world along the whole recording, at most `most`, of one of the tracks: x, y, z of each.
  trail(shown: Shown, recording: Recording, most: number): Float32Array {
    const rows = recording.rows;
    const count = Math.min(rows, most);
    const points = new Float32Array(3 * count);
    const columns = recording.values(shown.track.signal);
    const poses = shown.mechanism.bodies();
    const q = [...shown.q];
    const base = new three.Matrix4();
    for (let k = 0; k < count; ++k) {
      const row = count > 1 ? Math.round((k * (rows - 1)) / (count - 1)) : 0;
      columns?.forEach((column, i) => {
        if (Number.isFinite(column[row]!) && i < q.length) q[i] = column[row]!;
      });
      shown.mechanism.place(q, poses);
      const place = { row, next: row, share: 0 };
      this.base_pose.at(place, base);
      shown.base(place, base, base);
      const tip = frame_pose(this.robot, this.robot.tip, poses).premultiply(base);
      points[3 * k] = tip.elements[12]!;
      points[3 * k + 1] = tip.elements[13]!;
      points[3 * k + 2] = tip.elements[14]!;
    }
    return points;
  }
}

/// A body of the scene. Its simple shapes are drawn as instances, the others and those of ghosts in `group`.
export class BodyView {
  readonly group = new three.Group();
  private readonly pose: RecordedPose;
  private readonly members: Member[];
  private scale = 1;

  constructor(
    readonly body: Body,
    private readonly recording: Recording,
    points: (visual: object) => Float32Array | undefined,
    meshes: Meshes,
    material: three.MeshBasicMaterial,
    private readonly instances: Instances,
  ) {
    this.pose = new RecordedPose(body, recording, body.p_signal, body.quat_signal);
    this.group.matrixAutoUpdate = false;
    const taken = (visual: Visual): boolean => !body.ghost && Instances.takes(visual);
    this.group.visible = !body.ghost;
    this.members = body.visuals.filter(taken).map((visual) => instances.add(visual, material.color));
    for (const visual of body.visuals) {
      const object = taken(visual) ? undefined : visual_object(visual, points(visual), meshes, material, body.ghost);
      if (object !== undefined) this.group.add(object);
    }
  }

  get moves(): boolean {
    return this.pose.moves || this.body.obstacle !== undefined;
  }
  /// Of an obstacle; one that is not there is too small to be seen.
  private size({ row }: Place): number {
    const obstacle = this.body.obstacle;
    if (obstacle === undefined) return 1;
    const value = (signal: string, otherwise: number): number => this.recording.values(signal)?.[0]![row] ?? otherwise;
    return value(obstacle.present_signal, obstacle.present) === 0 ? 1e-9 : value(obstacle.scale_signal, obstacle.scale);
  }
  place(place: Place): void {
    this.pose.at(place, this.group.matrix);
    const size = (this.scale = this.size(place));
    if (size !== 1) this.group.matrix.scale(new three.Vector3(size, size, size));
    this.group.matrixWorldNeedsUpdate = true;
    for (const member of this.members) this.instances.place(member, this.group.matrix);
  }
  /// Of what is visible in the world; empty if nothing is.
  box(): three.Box3 {
    if (this.scale < 1e-6) return new three.Box3();
    const box = visible_box(this.group);
    for (const member of this.members) box.union(this.instances.box(member));
    return box;
  }
}

/// Names of all signals that the stage needs.
export function needed_signals(data: PageData): string[] {
  const names = new Set<string>();
  for (const figure of data.figures) {
    for (const at of [figure, ...figure.tracks]) names.add(at.base_p ?? '').add(at.base_quat ?? '');
    for (const track of figure.tracks) names.add(track.signal);
  }
  for (const body of data.bodies)
    names.add(body.p_signal).add(body.quat_signal).add(body.obstacle?.present_signal ?? '').add(body.obstacle?.scale_signal ?? '');
  for (const light of data.lights) names.add(light.zone);
  names.delete('');
  return [...names];
}
