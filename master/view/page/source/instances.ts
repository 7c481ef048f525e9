import * as three from 'three';
import type { Visual } from './format';
import { matrix_of } from './kinematics';
import { matte } from './materials';

type Shape = 'box' | 'sphere' | 'cylinder';

/// The shape that becomes a visual when it is scaled; undefined: none of them does.
function shape_of({ kind }: Visual): Shape | undefined {
  if (kind === 'ellipsoid') return 'sphere';
  return kind === 'box' || kind === 'sphere' || kind === 'cylinder' ? kind : undefined;
}

/// Of size 1: edges of a box, radius, length of a cylinder on z.
function unit_geometry(shape: Shape): three.BufferGeometry {
  if (shape === 'box') return new three.BoxGeometry(1, 1, 1);
  if (shape === 'cylinder') return new three.CylinderGeometry(1, 1, 1, 28).rotateX(Math.PI / 2); // three's cylinders stand on y
  return new three.SphereGeometry(1, 24, 16);
}

function scale_of({ kind, size: [x, y, z] }: Visual): three.Vector3 {
  if (kind === 'sphere') return new three.Vector3(x, x, x);
  return kind === 'cylinder' ? new three.Vector3(x, x, y) : new three.Vector3(x, y, z);
}

/// A shape that is drawn as instances, in the frame of its body.
export interface Member {
  shape: Shape;
  index: number;
  local: three.Matrix4;
}

/// The simple shapes of many bodies. All shapes of one kind are one call to the graphics card; a call for each would take most of the time of a frame.
export class Instances {
  readonly group = new three.Group();
  private readonly colours = new Map<Shape, three.Color[]>();
  private readonly meshes = new Map<Shape, three.InstancedMesh>();
  private readonly pose = new three.Matrix4();

  /// Whether the visual can be drawn as an instance: a simple shape that is not transparent.
  static takes(visual: Visual): boolean {
    return shape_of(visual) !== undefined && (visual.colour?.[3] ?? 1) >= 1;
  }

  /// `colour`: of a visual without one of its own. All members are added before `build`.
  add(visual: Visual, colour: three.Color): Member {
    const shape = shape_of(visual)!;
    const list = this.colours.get(shape) ?? [];
    this.colours.set(shape, list);
    const [r, g, b] = visual.colour ?? [];
    list.push(r === undefined ? colour : new three.Color().setRGB(r, g!, b!, three.SRGBColorSpace));
    return { shape, index: list.length - 1, local: matrix_of(visual).scale(scale_of(visual)) };
  }

  build(): void {
    for (const [shape, colours] of this.colours) {
      const mesh = new three.InstancedMesh(unit_geometry(shape), matte({}), colours.length);
      colours.forEach((colour, i) => mesh.setColorAt(i, colour));
      mesh.instanceMatrix.setUsage(three.DynamicDrawUsage);
      mesh.frustumCulled = false; // its bounds would have to be found again for each frame
      this.meshes.set(shape, mesh);
      this.group.add(mesh);
    }
  }

  /// `pose`: of the body of the member.
  place({ shape, index, local }: Member, pose: three.Matrix4): void {
    const mesh = this.meshes.get(shape)!;
    mesh.setMatrixAt(index, this.pose.multiplyMatrices(pose, local));
    mesh.instanceMatrix.needsUpdate = true;
  }

  /// The axis-parallel box of a member in the world.
  box({ shape, index }: Member): three.Box3 {
    const mesh = this.meshes.get(shape)!;
    if (mesh.geometry.boundingBox === null) mesh.geometry.computeBoundingBox();
    mesh.getMatrixAt(index, this.pose);
    return mesh.geometry.boundingBox!.clone().applyMatrix4(this.pose);
  }
}
