import { Matrix4, Vector3 } from 'three';
import type { Robot } from './format';
import { Mechanism, frame_pose } from './kinematics';

/// The tip of a robot at some joint positions, in the axes of its base: as master/view/calculated.cpp has it for recordings.
export interface TipState {
  /// J_v: three rows of n, with the base at rest.
  jacobian: number[][];
  /// The same, on a free base with its recoil (the generalised Jacobian); undefined without masses.
  moved: number[][] | undefined;
  /// Λ_v⁻¹ = J_v M⁻¹ J_vᵀ, 1/kg; undefined without masses.
  mobility: number[] | undefined;
  rotation: Matrix4;
}

const kSoftest = 1e-6; // N m/rad, of a joint without stiffness
const kSingular = 1e-9; // m/N, added where the joints cannot move the tip

/// A B Aᵀ of a 3×n matrix and the diagonal B, as xx xy xz yy yz zz.
function product(a: number[][], diagonal?: number[]): number[] {
  const term = (i: number, j: number): number => a[i]!.reduce((sum, x, k) => sum + x * a[j]![k]! * (diagonal?.[k] ?? 1), 0);
  return [term(0, 0), term(0, 1), term(0, 2), term(1, 1), term(1, 2), term(2, 2)];
}

/// The inverse of a symmetric 3×3 matrix.
export function inverse_of(m: number[]): number[] {
  const [a, b, c, d, e, f] = m as [number, number, number, number, number, number];
  const [A, B, C] = [d * f - e * e, c * e - b * f, b * e - c * d];
  const determinant = a * A + b * B + c * C;
  return [A, B, C, a * f - c * c, b * c - a * e, a * d - b * b].map((x) => x / determinant);
}

/// Solves L Lᵀ x = y for the symmetric positive matrix M, for several y. undefined: M is not positive.
function solve(M: number[][], columns: number[][]): number[][] | undefined {
  const n = M.length;
  const L = M.map((row) => [...row]);
  for (let j = 0; j < n; ++j) {
    for (let k = 0; k < j; ++k) for (let i = j; i < n; ++i) L[i]![j]! -= L[i]![k]! * L[j]![k]!;
    const pivot = L[j]![j]!;
    if (!(pivot > 0)) return undefined;
    const root = Math.sqrt(pivot);
    for (let i = j; i < n; ++i) L[i]![j]! /= root;
  }
  return columns.map((y) => {
    const x = [...y];
    for (let i = 0; i < n; ++i) {
      for (let k = 0; k < i; ++k) x[i]! -= L[i]![k]! * x[k]!;
      x[i]! /= L[i]![i]!;
    }
    for (let i = n - 1; i >= 0; --i) {
      for (let k = i + 1; k < n; ++k) x[i]! -= L[k]![i]! * x[k]!;
      x[i]! /= L[i]![i]!;
    }
    return x;
  });
}

/// Calculates with the kinematics and the masses of a robot; on a free base with six more columns: its linear and angular velocity.
export class TipCalculator {
  private readonly mechanism: Mechanism;
  private readonly poses: Matrix4[];

  constructor(
    private readonly robot: Robot,
    private readonly floats = false,
  ) {
    this.mechanism = new Mechanism(robot);
    this.poses = this.mechanism.bodies();
  }

  at(q: ArrayLike<number>): TipState {
    this.mechanism.place(q, this.poses);
    const { robot, poses } = this;
    const pose = frame_pose(robot, robot.tip, poses);
    const { linear } = this.jacobian(robot.frames[robot.tip]!.body, new Vector3().setFromMatrixPosition(pose));
    const M = this.inertia();
    const solved = M && solve(M, linear);
    const term = (i: number, j: number): number => linear[i]!.reduce((sum, x, k) => sum + x * solved![j]![k]!, 0);
    const mobility = solved && [term(0, 0), term(0, 1), term(0, 2), term(1, 1), term(1, 2), term(2, 2)];
    const jacobian = linear.map((row) => row.slice(0, robot.n));
    return { jacobian, moved: this.floats ? M && this.with_recoil(M, linear) : jacobian, mobility, rotation: pose.setPosition(0, 0, 0) };
  }

  /// J − J_b I_c⁻¹ F.
  private with_recoil(M: number[][], linear: number[][]): number[][] | undefined {
    const n = this.robot.n;
    const I_c = M.slice(n).map((row) => row.slice(n));
    const F = Array.from({ length: n }, (_, k) => M.slice(n).map((row) => row[k]!));
    const recoil = solve(I_c, F);
    return recoil && linear.map((row) => recoil.map((base, k) => row[k]! - base.reduce((sum, x, b) => sum + x * row[n + b]!, 0)));
  }

  /// Rows of the Jacobians of a point of a body: linear and angular, in the base.
  private jacobian(body: number, point: Vector3): { linear: number[][]; angular: number[][] } {
    const { robot, poses } = this;
    const zeros = (): number[][] => [0, 1, 2].map(() => new Array<number>(robot.n + (this.floats ? 6 : 0)).fill(0));
    const [linear, angular] = [zeros(), zeros()];
    for (let i = 0; this.floats && i < 3; ++i) {
      const axis = new Vector3().setComponent(i, 1);
      linear[i]![robot.n + i] = angular[i]![robot.n + 3 + i] = 1;
      axis.cross(point).toArray().forEach((v, row) => (linear[row]![robot.n + 3 + i] = v));
    }
    for (let b = body; b >= 0; b = robot.joints[b]!.parent) {
      const joint = robot.joints[b]!;
      const axis = new Vector3(...joint.axis).transformDirection(poses[b]!).multiplyScalar(joint.multiplier);
      const moved = joint.type === 'revolute' ? axis.clone().cross(point.clone().sub(new Vector3().setFromMatrixPosition(poses[b]!))) : axis;
      moved.toArray().forEach((v, i) => (linear[i]![joint.leader]! += v));
      if (joint.type === 'revolute') axis.toArray().forEach((v, i) => (angular[i]![joint.leader]! += v));
    }
    return { linear, angular };
  }

  /// M, on a free base [M Fᵀ; F I_c]; undefined without masses.
  private inertia(): number[][] | undefined {
    const { robot, poses } = this;
    if (robot.inertias === undefined || robot.inertias.some((body) => !(body.mass > 0))) return undefined;
    const n = robot.n + (this.floats ? 6 : 0);
    const M = Array.from({ length: n }, () => new Array<number>(n).fill(0));
    const base = this.floats && robot.base_inertia ? [robot.base_inertia] : [];
    [...robot.inertias, ...base].forEach(({ mass, com, inertia }, index) => {
      const body = index < robot.inertias!.length ? index : -1;
      const pose = body < 0 ? new Matrix4() : poses[body]!;
      const { linear, angular } = this.jacobian(body, new Vector3(...com).applyMatrix4(pose));
      // Angular velocities in the axes of the body, where the inertia is given.
      const e = pose.elements;
      const local = [0, 1, 2].map((axis) => angular[0]!.map((_, k) => e[4 * axis]! * angular[0]![k]! + e[4 * axis + 1]! * angular[1]![k]! + e[4 * axis + 2]! * angular[2]![k]!));
      const [xx, xy, xz, yy, yz, zz] = inertia as [number, number, number, number, number, number];
      const I = [
        [xx, xy, xz],
        [xy, yy, yz],
        [xz, yz, zz],
      ];
      for (let i = 0; i < n; ++i) {
        for (let j = 0; j < n; ++j) {
          for (let a = 0; a < 3; ++a) {
            M[i]![j]! += mass * linear[a]![i]! * linear[a]![j]!;
            for (let b = 0; b < 3; ++b) M[i]![j]! += local[a]![i]! * I[a]![b]! * local[b]![j]!;
          }
        }
      }
    });
    return M;
  }
}

/// J_v J_vᵀ: half-axes squared of the velocities for joint speeds of norm 1.
export function velocity_of(state: TipState): number[] | undefined {
  return state.moved && product(state.moved);
}

/// The stiffness of the tip from that of the joints, N/m: (J_v S⁻¹ J_vᵀ)⁻¹.
export function joint_stiffness(state: TipState, S: number[]): number[] {
  const softness = product(
    state.jacobian,
    S.map((s) => 1 / Math.max(kSoftest, s)),
  );
  for (const k of [0, 3, 5]) softness[k]! += kSingular;
  return inverse_of(softness);
}

/// The stiffness of the tip from that along the axes of the base or, with `in_tool`, of the tip, N/m.
export function frame_stiffness(state: TipState, S: number[], in_tool: boolean): number[] {
  if (!in_tool) return [S[0]!, 0, 0, S[1]!, 0, S[2]!];
  const e = state.rotation.elements;
  const R = [0, 1, 2].map((row) => [0, 1, 2].map((column) => e[4 * column + row]!));
  return product(R, S);
}
