import * as three from 'three';

/// The height of the smallest robot in that of the view, where that can be.
const kLeastShare = 0.205;
/// Where the camera is beside the robots: azimuths, and elevation, degrees.
const kAzimuths = [-50, 50, -40, 40, -30, 30, -20, 20, -130, 130, -140, 140, -150, 150, -160, 160];
const kElevation = 22;
const kMore = 0.05; // by which another side must show more of bodies that move, or less of what they hide
const kMostOthers = 300;
/// The edge beside what is in view, as a factor.
const kEdge = 1.05;
const kNearest = 0.3; // m
const kUp = new three.Vector3(0, 0, 1);

const is_plane = (object: three.Object3D): object is three.Mesh => object instanceof three.Mesh && (object.geometry as three.BufferGeometry).type === 'PlaneGeometry';

export const corners_of = ({ min, max }: three.Box3): three.Vector3[] => [...Array(8).keys()].map((k) => new three.Vector3(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z));

/// Corners in the world of the boxes of all that is visible of an object; planes have no size.
export function visible_corners(object: three.Object3D): three.Vector3[] {
  object.updateWorldMatrix(true, true);
  const corners: three.Vector3[] = [];
  object.traverseVisible((part) => {
    const { geometry } = part as Partial<three.Mesh>;
    if (geometry === undefined || is_plane(part)) return;
    if (geometry.boundingBox === null) geometry.computeBoundingBox();
    corners.push(...corners_of(geometry.boundingBox!).map((corner) => corner.applyMatrix4(part.matrixWorld)));
  });
  return corners;
}

export const visible_box = (object: three.Object3D): three.Box3 => new three.Box3().setFromPoints(visible_corners(object));

/// The heights of the level planes of an object, m.
export function heights_of_planes(object: three.Object3D): number[] {
  object.updateWorldMatrix(true, true);
  const heights: number[] = [];
  object.traverseVisible((part) => {
    const e = part.matrixWorld.elements;
    if (is_plane(part) && Math.abs(e[10]) > 0.99) heights.push(e[14]);
  });
  return heights;
}

/// Points of robots, where they and their tips come to, and corners of other bodies at some places.
export interface Seen {
  robots: three.Vector3[][];
  ways: three.Vector3[];
  bodies: three.Vector3[][][];
}

export interface Aim {
  position: three.Vector3;
  target: three.Vector3;
}

type Sides = [right: number, left: number, top: number, bottom: number, near: number, far: number];

/// A camera with a direction, and the bounds of all that it has in view: of the four sides, and of the depth.
class Fit {
  private readonly right: three.Vector3;
  private readonly up: three.Vector3;
  private readonly slopes: [number, number];
  bounds = Array<number>(6).fill(-Infinity);

  /// `back`: from what is looked at to the camera; `slope`: of the upper side of the view.
  constructor(
    private readonly back: three.Vector3,
    aspect: number,
    slope: number,
  ) {
    this.right = new three.Vector3().crossVectors(kUp, back).normalize();
    this.up = new three.Vector3().crossVectors(back, this.right);
    this.slopes = [(slope * aspect) / kEdge, slope / kEdge];
  }
  /// The bounds with further points.
  with(points: three.Vector3[]): number[] {
    const [x, y] = this.slopes;
    let [right, left, top, bottom, near, far] = this.bounds as Sides;
    for (const point of points) {
      const [r, u, b] = [point.dot(this.right), point.dot(this.up), point.dot(this.back)];
      if (!Number.isFinite(r + u + b)) continue;
      [right, left] = [Math.max(right, r + x * b), Math.max(left, x * b - r)];
      [top, bottom] = [Math.max(top, u + y * b), Math.max(bottom, y * b - u)];
      [near, far] = [Math.max(near, b), Math.max(far, -b)];
    }
    return [right, left, top, bottom, near, far];
  }
  /// How far along `back` the camera is.
  depth([a, b, c, d] = this.bounds): number {
    return Math.max((a! + b!) / (2 * this.slopes[0]), (c! + d!) / (2 * this.slopes[1]));
  }
  /// The height of points as a share of that of the view.
  share(points: three.Vector3[], bounds: number[]): number {
    const [depth, middle] = [this.depth(bounds), (bounds[2]! - bounds[3]!) / 2];
    let [low, high] = [Infinity, -Infinity];
    for (const point of points) {
      const height = (point.dot(this.up) - middle) / (this.slopes[1] * kEdge * (depth - point.dot(this.back)));
      [low, high] = [Math.min(low, height), Math.max(high, height)];
    }
    return (high - low) / 2;
  }
  aim(): Aim {
    const [a, b, c, d, near, far] = this.bounds as Sides;
    const middle = (near - far) / 2;
    const target = this.right.clone().multiplyScalar((a - b) / 2).addScaledVector(this.up, (c - d) / 2).addScaledVector(this.back, middle);
    return { target, position: target.clone().addScaledVector(this.back, Math.max(this.depth() - middle, kNearest)) };
  }
}

/// Whether the box hides the point from the eye.
const hides = (box: three.Box3, point: three.Vector3, eye: three.Vector3): boolean => {
  const hit = new three.Ray(eye, point.clone().sub(eye).normalize()).intersectBox(box, new three.Vector3());
  return hit !== null && !box.containsPoint(point) && hit.distanceTo(eye) < point.distanceTo(eye);
};

/// Where the camera has robots and the ways of their tips in view, and of other bodies those places at which the robots stay large, the nearest ones
/// first. It looks from the first side from which the robots are large enough, unless it sees more of bodies that move from another one, or bodies hide
/// less of the robots.
export function aim_at({ robots, ways, bodies }: Seen, aspect: number, slope: number): Aim {
  const others = bodies.flatMap((places) => places.map((corners) => ({ corners, box: new three.Box3().setFromPoints(corners), moves: places.length > 1, share: 1 / places.length }))).filter(({ corners }) => corners.length > 0);
  const centres = robots.map((robot) => new three.Box3().setFromPoints(robot).getCenter(new three.Vector3()));
  const framed = kAzimuths.map((azimuth) => {
    const [a, e] = [azimuth, kElevation].map((degrees) => (degrees * Math.PI) / 180) as [number, number];
    const fit = new Fit(new three.Vector3(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)), aspect, slope);
    fit.bounds = fit.with([...robots.flat(), ...ways]);
    const smallest = (bounds: number[]): number => Math.min(...robots.map((robot) => fit.share(robot, bounds)));
    const least = Math.min(smallest(fit.bounds), kLeastShare);
    let seen = 0;
    const nearest = others.map((other) => ({ ...other, depth: fit.depth(fit.with(other.corners)) })).sort((one, other) => one.depth - other.depth).slice(0, kMostOthers);
    for (const { corners, moves, share } of nearest) {
      const bounds = fit.with(corners);
      if (smallest(bounds) < least) continue;
      fit.bounds = bounds;
      if (moves) seen += share;
    }
    const aim = fit.aim();
    for (const { box, share } of nearest) seen -= share * centres.filter((centre) => hides(box, centre, aim.position)).length;
    return { aim, least, seen };
  });
  return framed.reduce((best, one) => (one.least > best.least + 0.01 || (one.least >= best.least && one.seen > best.seen + kMore) ? one : best)).aim;
}
