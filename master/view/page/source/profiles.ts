import * as three from 'three';
import { kCues } from './colours';
import type { Cue, Scenery } from './cues';
import type { Profile } from './format';
import type { Place } from './recording';

/// Lines of a fan, at most.
const kBeams = 40;

/// The last profile of each scanner: a fan of beams, and all points that they met.
export class Profiles implements Cue {
  readonly id = 'profiles';
  readonly label = 'profiles of scanners';
  readonly key = 'b';
  readonly colour = kCues.profile;
  readonly lacks: string;
  readonly needs: string[];
  readonly calculates: string[] = [];
  private readonly group = new three.Group();
  private readonly profiles: Profile[];
  private readonly beams = new three.LineSegments(new three.BufferGeometry(), new three.LineBasicMaterial({ color: kCues.profile, transparent: true, opacity: 0.45 }));
  private readonly points: three.Points;
  constructor(
    private readonly s: Scenery,
    size: number,
  ) {
    this.profiles = s.data.profiles ?? [];
    this.lacks = s.data.profiles_lack ?? 'the page was made by an earlier version';
    this.needs = this.profiles.flatMap(({ ranges, p, quat, increment }) => [ranges, p, quat, increment]);
    this.points = new three.Points(new three.BufferGeometry(), new three.PointsMaterial({ color: kCues.profile, size: 0.02 * size }));
    this.points.name = this.id;
    this.beams.frustumCulled = this.points.frustumCulled = false;
    this.group.add(this.beams, this.points);
  }
  build(): void {
    this.s.scene.add(this.group);
  }
  show(on: boolean): void {
    this.group.visible = on;
  }
  /// A profile holds until the next one, so it is not interpolated.
  update({ row }: Place): string[] {
    const [lines, points]: [three.Vector3[], three.Vector3[]] = [[], []];
    const texts = this.profiles.map((profile) => {
      const at = (name: string): number[] => this.s.recording.values(name)?.map((column) => column[row]!) ?? [];
      const [ranges, p, [w, x, y, z], [increment]] = [at(profile.ranges), new three.Vector3(...at(profile.p)), at(profile.quat), at(profile.increment)];
      const quat = new three.Quaternion(x, y, z, w);
      const before = points.length;
      for (const [i, range] of ranges.entries()) {
        if (!(range > 0)) continue;
        const angle = (i - (ranges.length - 1) / 2) * increment!;
        const point = new three.Vector3(range * Math.sin(angle), 0, range * Math.cos(angle)).applyQuaternion(quat).add(p);
        points.push(point);
        if (i % Math.ceil(ranges.length / kBeams) === 0) lines.push(p, point);
      }
      return `${profile.name}: ${points.length - before} of ${ranges.length} beams came back`;
    });
    for (const [object, places] of [[this.beams, lines], [this.points, points]] as const) {
      object.geometry.dispose();
      object.geometry = new three.BufferGeometry().setFromPoints(places);
    }
    return texts;
  }
}
