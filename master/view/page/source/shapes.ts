import * as three from 'three';
import { ConvexGeometry } from 'three/examples/jsm/geometries/ConvexGeometry.js';
import type { Robot, Visual } from './format';
import { matrix_of, reach_of } from './kinematics';
import { matte } from './materials';

/// The meshes of a page, by index: undefined where a file could not be read.
export type Meshes = (three.Object3D | undefined)[];

export interface Looks {
  body: three.MeshBasicMaterial;
  joint: three.Material;
  /// Of the solids of the base, then of the bodies in turns, so that neighbours differ.
  base: three.Material;
  links: three.Material[];
}

export function looks_of(colour: string, opacity: number): Looks {
  const transparent = opacity < 1;
  // A ghost that is where its robot is does not cover it.
  const common = { transparent, opacity, depthWrite: !transparent, polygonOffset: transparent, polygonOffsetFactor: 2, polygonOffsetUnits: 8 };
  const made = (own: string): three.MeshBasicMaterial => matte({ color: transparent ? colour : own, ...common });
  return { body: made('#c9cdd3'), joint: made(colour), base: made('#6d7784'), links: [made('#dfe3e8'), made('#f0a24a')] };
}

/// A solid of revolution about the line from a to b, with these radii at the ends.
function rod(a: three.Vector3, b: three.Vector3, radius_a: number, radius_b: number, material: three.Material): three.Mesh {
  const length = a.distanceTo(b);
  const mesh = new three.Mesh(new three.CylinderGeometry(radius_b, radius_a, length, 20), material);
  mesh.position.copy(a).add(b).multiplyScalar(0.5);
  mesh.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), b.clone().sub(a).normalize());
  return mesh;
}

function ball(at: three.Vector3, radius: number, material: three.Material): three.Mesh {
  const mesh = new three.Mesh(new three.SphereGeometry(radius, 20, 14), material);
  mesh.position.copy(at);
  return mesh;
}

/// The clean shape of a robot without visuals: of the base, then of each body, in its frame. Barrels along the axes of the joints, tapered rods from
/// joint to joint.
export function clean_shapes(robot: Robot, looks: Looks): three.Group[] {
  const groups = Array.from({ length: robot.joints.length + 1 }, () => new three.Group());
  const depth: number[] = [];
  for (const body of robot.order) depth[body] = 1 + (robot.joints[body]!.parent >= 0 ? depth[robot.joints[body]!.parent]! : 0);
  const deepest = Math.max(1, ...depth.filter((d) => d !== undefined));
  const reach = reach_of(robot);
  const radius = (body: number): number => reach * (0.052 - (0.024 * (body < 0 ? 0 : depth[body]!)) / deepest);
  const origin = new three.Vector3();
  const is_parent = new Set(robot.joints.map((joint) => joint.parent));

  robot.joints.forEach((joint, body) => {
    const r = radius(body);
    const axis = new three.Vector3(...joint.axis);
    const group = groups[body + 1]!;
    if (joint.type === 'revolute') {
      const end = axis.clone().multiplyScalar(1.25 * r);
      group.add(rod(end.clone().negate(), end, r, r, looks.joint));
      const cap = axis.clone().multiplyScalar(1.35 * r);
      group.add(rod(cap.clone().negate(), cap, 0.72 * r, 0.72 * r, looks.body));
    } else {
      const box = new three.Mesh(new three.BoxGeometry(2.1 * r, 2.1 * r, 2.6 * r), looks.joint);
      box.quaternion.setFromUnitVectors(new three.Vector3(0, 0, 1), axis);
      group.add(box);
      // A rail along which the body slides, on its parent.
      const low = joint.min ?? 0;
      const high = joint.max ?? 0;
      if (high > low) {
        const place = matrix_of(joint);
        const [a, b] = [low, high].map((x) => axis.clone().multiplyScalar(x).applyMatrix4(place)) as [three.Vector3, three.Vector3];
        groups[joint.parent + 1]!.add(rod(a, b, 0.5 * r, 0.5 * r, looks.body));
      }
    }
    const start = new three.Vector3(...joint.p);
    const before = groups[joint.parent + 1]!;
    if (start.length() > 0.2 * r) {
      const thick = 0.86 * radius(joint.parent);
      before.add(rod(origin, start, thick, 0.86 * r, looks.body));
      before.add(ball(start, 0.86 * r, looks.body));
    }
  });
  const tip = robot.frames[robot.tip];
  if (tip !== undefined && !is_parent.has(tip.body)) {
    const end = new three.Vector3(...tip.p);
    const r = radius(tip.body);
    const group = groups[tip.body + 1]!;
    if (end.length() > 0.2 * r) group.add(rod(origin, end, 0.8 * r, 0.55 * r, looks.body));
    const pose = matrix_of(tip);
    const out = new three.Vector3().setFromMatrixColumn(pose, 2);
    group.add(rod(end.clone().addScaledVector(out, -0.12 * r), end.clone().addScaledVector(out, 0.12 * r), 0.62 * r, 0.62 * r, looks.joint));
  }
  const foot = 1.5 * radius(-1);
  groups[0]!.add(rod(new three.Vector3(0, 0, 0), new three.Vector3(0, 0, 0.3 * foot), foot, foot * 0.9, looks.body));
  return groups;
}

function geometry_of(visual: Visual, points: Float32Array | undefined): three.BufferGeometry | undefined {
  const [x, y, z] = visual.size;
  const upright = (geometry: three.BufferGeometry): three.BufferGeometry => geometry.rotateX(Math.PI / 2); // three's cylinders stand on y
  if (visual.kind === 'box') return new three.BoxGeometry(x, y, z);
  if (visual.kind === 'sphere') return new three.SphereGeometry(x, 24, 16);
  if (visual.kind === 'ellipsoid') return new three.SphereGeometry(1, 24, 16).scale(x, y, z);
  if (visual.kind === 'cylinder') return upright(new three.CylinderGeometry(x, x, y, 28));
  if (visual.kind === 'capsule') return upright(new three.CapsuleGeometry(x, y, 8, 20));
  if (visual.kind === 'plane') return new three.PlaneGeometry(20, 20);
  if (points === undefined) return undefined;
  if (visual.kind === 'hull') {
    const corners: three.Vector3[] = [];
    for (let i = 0; i + 2 < points.length; i += 3) corners.push(new three.Vector3(points[i], points[i + 1], points[i + 2]));
    return corners.length >= 4 ? new ConvexGeometry(corners) : undefined;
  }
  const geometry = new three.BufferGeometry();
  geometry.setAttribute('position', new three.BufferAttribute(points, 3));
  geometry.computeVertexNormals();
  return geometry;
}

/// Replaces all materials below an object by one.
export function dress(object: three.Object3D, material: three.Material): void {
  object.traverse((part) => {
    if (part instanceof three.Mesh) part.material = material;
  });
}

/// A visual in the frame of its body. `points`: unpacked, of hulls and triangles. Without a colour of its own it gets `material`; with `only` also
/// otherwise. Returns undefined for a mesh that could not be read.
export function visual_object(visual: Visual, points: Float32Array | undefined, meshes: Meshes, material: three.Material, only: boolean): three.Object3D | undefined {
  let own = material;
  if (visual.colour !== undefined && !only) {
    const [r, g, b, a] = visual.colour;
    own = matte({ color: new three.Color().setRGB(r, g, b, three.SRGBColorSpace), transparent: a < 1, opacity: a });
    if (visual.kind === 'triangles') own.side = three.DoubleSide;
  }
  let object: three.Object3D;
  if (visual.kind === 'mesh') {
    const mesh = meshes[visual.mesh ?? -1];
    if (mesh === undefined) return undefined;
    object = new three.Group().add(mesh.clone());
    object.scale.set(...visual.size);
    if (only || visual.colour !== undefined) dress(object, own);
    else {
      object.traverse((part) => {
        if (part instanceof three.Mesh && part.userData['plain'] === true) part.material = own;
      });
    }
  } else {
    const geometry = geometry_of(visual, points);
    if (geometry === undefined) return undefined;
    object = new three.Mesh(geometry, own);
  }
  const placed = new three.Group().add(object);
  matrix_of(visual).decompose(placed.position, placed.quaternion, placed.scale);
  return placed;
}
