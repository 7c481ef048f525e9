import { Matrix4, Quaternion, Vector3 } from 'three';
import type { Pose, Robot } from './format';

/// The matrix of a pose X_RT.
export function matrix_of(pose: Pose): Matrix4 {
  const [w, x, y, z] = pose.quat;
  return new Matrix4().compose(new Vector3(...pose.p), new Quaternion(x, y, z, w), new Vector3(1, 1, 1));
}

/// Forward kinematics of a robot in its base.
export class Mechanism {
  private readonly fixed: Matrix4[];
  private readonly axes: Vector3[];
  private readonly moved = new Matrix4();

  constructor(readonly robot: Robot) {
    this.fixed = robot.joints.map(matrix_of);
    this.axes = robot.joints.map((joint) => new Vector3(...joint.axis));
  }

  /// Writes the poses of the bodies, X_BL, into `poses`, one per joint. `q`: n positions, rad or m.
  place(q: ArrayLike<number>, poses: Matrix4[]): void {
    for (const body of this.robot.order) {
      const joint = this.robot.joints[body]!;
      const position = joint.multiplier * q[joint.leader]! + joint.offset;
      const axis = this.axes[body]!;
      if (joint.type === 'revolute') this.moved.makeRotationAxis(axis, position);
      else this.moved.makeTranslation(axis.x * position, axis.y * position, axis.z * position);
      const pose = poses[body]!;
      pose.multiplyMatrices(this.fixed[body]!, this.moved);
      if (joint.parent >= 0) pose.premultiply(poses[joint.parent]!);
    }
  }

  bodies(): Matrix4[] {
    return this.robot.joints.map(() => new Matrix4());
  }
}

/// The pose of a frame, from those of the bodies.
export function frame_pose(robot: Robot, frame: number, poses: Matrix4[]): Matrix4 {
  const { body } = robot.frames[frame]!;
  const pose = matrix_of(robot.frames[frame]!);
  return body >= 0 ? pose.premultiply(poses[body]!) : pose;
}

/// Sum of the distances between the joints on the way to the tip, m: about how far the robot reaches.
export function reach_of(robot: Robot): number {
  const tip = robot.frames[robot.tip];
  let reach = tip !== undefined ? Math.hypot(...tip.p) : 0;
  for (let body = tip?.body ?? -1; body >= 0; body = robot.joints[body]!.parent) {
    const joint = robot.joints[body]!;
    reach += Math.hypot(...joint.p);
    if (joint.type === 'prismatic' && joint.min !== null && joint.max !== null) reach += Math.max(Math.abs(joint.min), Math.abs(joint.max));
  }
  return reach > 1e-3 ? reach : 1;
}
