import * as three from 'three';
import type { CloudView } from './clouds';
import type { BodyView, FigureView } from './figures';
import { corners_of, heights_of_planes, visible_corners, type Seen } from './framing';
import type { Recording } from './recording';

const kMostTimes = 20; // at which it is looked for where something is
const kMostGround = 5; // sizes of what is in view at first
const kThin = 1e-3; // m

const rests = (view: FigureView): boolean => view.figure.base_p === '';

/// What there is around the robots.
export class Surroundings {
  constructor(
    private readonly figures: FigureView[],
    private readonly bodies: BodyView[],
    private readonly clouds: CloudView[],
    private readonly scenery: Recording,
    private readonly now: () => number,
  ) {}

  /// What a camera should have in view when the page is opened; without robots all bodies.
  at_first(): Seen {
    const robots = this.figures.map((view) => visible_corners(view.main.group)).filter((corners) => corners.length > 0);
    if (robots.length === 0) robots.push(corners_of(new three.Box3().setFromPoints(this.whole())));
    const others = this.figures.filter((view) => !rests(view)).map((view) => this.ways(view));
    return { robots, ways: this.ways_at_rest(), bodies: [...others, ...this.places()] };
  }
  /// All that is visible now, and where robots that rest on something come to.
  everything(): Seen {
    return { robots: [this.whole()], ways: this.ways_at_rest(), bodies: [] };
  }
  /// The box of all that is visible now and not far from what is seen at first. Its lower side is that of the ground: z = 0, or lower where something is below that.
  above_ground({ robots, ways }: Seen): three.Box3 {
    const near = new three.Box3().setFromPoints([...robots.flat(), ...ways]);
    const most = kMostGround * near.getSize(new three.Vector3()).length();
    const all = new three.Box3().setFromPoints(this.whole()).union(near).intersect(near.expandByScalar(most));
    const planes = this.bodies.flatMap((view) => heights_of_planes(view.group));
    all.min.z = Math.min(0, all.min.z, ...planes);
    // The lines of the ground are on a plane, not hidden by it.
    if (Math.min(...planes) <= all.min.z + kThin) all.min.z += 2 * kThin;
    return all;
  }
  /// Corners of everything that is visible now.
  whole(): three.Vector3[] {
    const boxes = [...this.bodies, ...this.clouds].map((view) => view.box()).filter((box) => !box.isEmpty());
    const corners = [...this.figures.flatMap((view) => visible_corners(view.group)), ...boxes.flatMap(corners_of)];
    return corners.length > 0 ? corners : corners_of(new three.Box3(new three.Vector3(-0.5, -0.5, 0), new three.Vector3(0.5, 0.5, 1)));
  }

  private ways_at_rest(): three.Vector3[] {
    return this.figures.filter(rests).flatMap((view) => this.ways(view).flat());
  }
  /// What `look` finds now and at some times of the recording.
  private over_time(view: FigureView | BodyView, most: number, look: () => three.Vector3[]): three.Vector3[][] {
    const { rows } = this.scenery;
    const count = Math.min(rows, most);
    const found = [look()];
    for (let k = 0; k < count; ++k) {
      const row = Math.round((k * (rows - 1)) / Math.max(1, count - 1));
      view.place({ row, next: row, share: 0 }, this.scenery.time[row]!);
      found.push(look());
    }
    view.place(this.scenery.place(this.now()), this.now());
    return found;
  }
  /// Where robots are, and the ways of their tips.
  private ways(view: FigureView): three.Vector3[][] {
    const way = view.trail(view.main, this.scenery, 100);
    const points = Array.from({ length: way.length / 3 }, (_, i) => [new three.Vector3(...way.subarray(3 * i))]);
    const q = [...view.main.q];
    const poses = this.over_time(view, kMostTimes, () => visible_corners(view.main.group));
    // A joint without a number stays where it was, which must not be where it was looked for.
    q.forEach((position, joint) => (view.main.q[joint] = position));
    view.place(this.scenery.place(this.now()), this.now());
    return [...points, ...poses];
  }
  /// Where bodies and clouds are.
  private places(): three.Vector3[][][] {
    const most = Math.min(kMostTimes, Math.ceil((50 * kMostTimes) / this.bodies.length));
    const corners = (view: BodyView | CloudView): three.Vector3[] => (view.box().isEmpty() ? [] : corners_of(view.box()));
    return [...this.clouds.map((view) => [corners(view)]), ...this.bodies.map((view) => this.over_time(view, view.moves ? most : 0, () => corners(view)))];
  }
}
