import * as three from 'three';
import { kCues } from './colours';
import type { Cloud } from './format';
import { unpack } from './packed';

/// So many nearest points can be marked, and points as far from them, m.
const kMostMarks = 8;
const kReach = 0.3;
/// The least size of a point in the picture, pixels.
const kPixels = 1.6;

const kVertex = `
uniform vec2 heights;
uniform vec3 lowest;
uniform vec3 highest;
uniform vec3 marked;
uniform vec3 marks[${kMostMarks}];
uniform int count;
uniform float pixels; // of a point at 1 m
varying vec3 colour;
void main() {
  vec4 world = modelMatrix * vec4(position, 1.0);
  colour = mix(lowest, highest, clamp((world.z - heights.x) / max(heights.y - heights.x, 1e-3), 0.0, 1.0));
  float nearest = ${kReach.toFixed(2)};
  for (int i = 0; i < ${kMostMarks}; ++i) {
    if (i < count) nearest = min(nearest, distance(world.xyz, marks[i]));
  }
  if (nearest < ${kReach.toFixed(2)}) colour = marked;
  gl_Position = projectionMatrix * viewMatrix * world;
  gl_PointSize = max(${kPixels.toFixed(2)}, pixels / gl_Position.w);
}`;
const kFragment = `
varying vec3 colour;
void main() {
  gl_FragColor = vec4(colour, 1.0);
  #include <colorspace_fragment>
}`;

/// The nearest points around which the points of clouds are marked: cues set them.
export class Marks {
  readonly uniforms = {
    marks: { value: Array.from({ length: kMostMarks }, () => new three.Vector3()) },
    count: { value: 0 },
  };
  set(points: three.Vector3[]): void {
    this.uniforms.count.value = Math.min(points.length, kMostMarks);
    for (const [k, p] of points.slice(0, kMostMarks).entries()) this.uniforms.marks.value[k]!.copy(p);
  }
}

/// The points of a cloud, coloured by height, those near a mark in the colour of distances.
export class CloudView {
  readonly group = new three.Group();
  private constructor(cloud: Cloud, steps: Float32Array | Float64Array, marks: Marks) {
    const n = steps.length / 3;
    const places = new Uint16Array(3 * n);
    for (let k = 0; k < n; ++k) for (let i = 0; i < 3; ++i) places[3 * k + i] = steps[i * n + k]!;
    const geometry = new three.BufferGeometry();
    geometry.setAttribute('position', new three.BufferAttribute(places, 3));
    const heights = { value: new three.Vector2() };
    const pixels = { value: 1 };
    const uniforms = {
      heights,
      pixels,
      lowest: { value: new three.Color('#7d8794') },
      highest: { value: new three.Color('#c2a878') },
      marked: { value: new three.Color(kCues.distance) },
      ...marks.uniforms,
    };
    const points = new three.Points(geometry, new three.ShaderMaterial({ vertexShader: kVertex, fragmentShader: kFragment, uniforms }));
    points.position.set(...cloud.low);
    points.scale.set(...cloud.step);
    const [w, x, y, z] = cloud.quat;
    this.group.position.set(...cloud.p);
    this.group.quaternion.set(x, y, z, w);
    this.group.add(points);
    const box = this.box();
    heights.value.set(box.min.z, box.max.z);
    points.onBeforeRender = (renderer, _scene, camera) => {
      const lens = camera as three.PerspectiveCamera;
      pixels.value = cloud.size * (renderer.domElement.height / 2) * lens.projectionMatrix.elements[5]!;
    };
  }
  /// `numbers`: packed, base64.
  static async make(cloud: Cloud, numbers: string, marks: Marks): Promise<CloudView> {
    return new CloudView(cloud, await unpack(numbers, cloud.points), marks);
  }
  box(): three.Box3 {
    this.group.updateMatrixWorld(true);
    return new three.Box3().setFromObject(this.group);
  }
}
