import * as three from 'three';
import { kCues, kZones } from './colours';
import type { Cue, Scenery } from './cues';
import { short } from './dom';
import { matte } from './materials';
import type { Place } from './recording';

/// The line between two nearest points, with its length beside it.
class Measure {
  readonly group = new three.Group();
  private readonly line: three.Mesh;
  private readonly ends: three.Mesh[];
  /// As large on the screen wherever it is, and over everything else.
  private readonly label = new three.Sprite(new three.SpriteMaterial({ depthTest: false, sizeAttenuation: false }));
  private readonly canvas = document.createElement('canvas');
  private readonly material = matte({ color: kCues.distance });
  private text = '';
  /// `above`: of the label over the middle, in its heights.
  constructor(size: number, above: number) {
    this.line = new three.Mesh(new three.CylinderGeometry(0.007 * size, 0.007 * size, 1, 8), this.material);
    this.ends = [0, 1].map(() => new three.Mesh(new three.SphereGeometry(0.016 * size, 12, 8), this.material));
    [this.canvas.width, this.canvas.height] = [768, 64];
    this.label.renderOrder = 10;
    this.label.center.set(0.5, 0.5 - above);
    this.label.material.map = new three.CanvasTexture(this.canvas);
    this.label.material.map.colorSpace = three.SRGBColorSpace;
    this.label.scale.set(0.3, 0.025, 1);
    this.group.add(this.line, ...this.ends, this.label);
  }
  /// Hidden if `is_there` is false or a point is no number.
  set(a: three.Vector3, b: three.Vector3, is_there: boolean, text: string, colour: string): void {
    this.group.visible = is_there && Number.isFinite(a.length() + b.length());
    if (!this.group.visible) return;
    this.material.color.set(colour);
    const way = b.clone().sub(a);
    this.line.position.copy(a).addScaledVector(way, 0.5);
    this.line.scale.set(1, Math.max(way.length(), 1e-6), 1);
    this.line.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), way.length() > 0 ? way.normalize() : new three.Vector3(0, 1, 0));
    this.ends[0]!.position.copy(a);
    this.ends[1]!.position.copy(b);
    this.label.position.copy(this.line.position);
    this.relabel(text, colour);
  }
  private relabel(text: string, colour: string): void {
    if (text + colour === this.text) return;
    this.text = text + colour;
    const context = this.canvas.getContext('2d')!;
    context.clearRect(0, 0, 768, 64);
    context.font = '600 44px system-ui, sans-serif';
    context.textAlign = 'center';
    const width = context.measureText(text).width + 24;
    context.fillStyle = 'rgba(255, 255, 255, 0.85)';
    context.fillRect(384 - width / 2, 4, width, 56);
    context.fillStyle = colour;
    context.fillText(text, 384, 48);
    this.label.material.map!.needsUpdate = true;
  }
}

/// Of m, for a label.
const millimetres = (x: number): string => `${(1000 * x).toFixed(Math.abs(x) < 0.01 ? 1 : 0)} mm`;

/// Distances that a monitor measures, red where shapes overlap; the pair that counts for separation in the colour of its zone, with S_p; the hulls as
/// they are inflated.
export class Distances implements Cue {
  readonly id = 'distances';
  readonly label = 'distances';
  readonly key = 'x';
  readonly colour = kCues.distance;
  readonly lacks: string;
  readonly needs: string[];
  readonly calculates: string[] = [];
  private readonly group = new three.Group();
  private readonly measures: Measure[] = [];
  private readonly aparts: (Measure | undefined)[] = [];
  private readonly veils: three.Object3D[] = [];
  constructor(
    private readonly s: Scenery,
    private readonly size: number,
  ) {
    this.lacks = s.data.distances_lack;
    this.needs = s.data.distances.flatMap(({ p_a, p_b, distance, apart }) => [p_a, p_b, distance, ...(apart === undefined ? [] : [apart.p_a, apart.p_b, apart.S_p, apart.zone])]);
  }
  build(): void {
    for (const source of this.s.data.distances) {
      if (this.s.recording.values(source.p_a)?.length !== 3) continue;
      const apart = source.apart === undefined ? undefined : new Measure(this.size, 1.1);
      this.measures.push(new Measure(this.size, 0));
      this.aparts.push(apart);
      this.group.add(this.measures.at(-1)!.group, ...(apart === undefined ? [] : [apart.group]));
      const figure = this.s.figures[source.figure ?? -1];
      if (figure !== undefined && (source.r ?? 0) > 0) this.veils.push(...figure.veil(source.r!));
    }
    this.s.scene.add(this.group);
  }
  show(on: boolean): void {
    this.group.visible = on;
    for (const veil of this.veils) veil.visible = on;
    if (!on) this.s.marks.set([]);
  }
  /// The nearest pair changes from one row to the next, so points are not interpolated.
  update({ row }: Place): string[] {
    const at = (name: string): three.Vector3 => {
      const columns = this.s.recording.values(name)!;
      return new three.Vector3(columns[0]![row], columns[1]![row], columns[2]![row]);
    };
    const shown = this.s.data.distances.slice(0, this.measures.length);
    const length = (name: string): number => this.s.recording.values(name)![0]![row]!;
    this.s.marks.set(shown.filter((source) => length(source.distance) < 1e11).map((source) => at(source.p_b)));
    return shown.map(({ name, p_a, p_b, distance, apart }, k) => {
      const d = length(distance);
      this.measures[k]!.set(at(p_a), at(p_b), d < 1e11, millimetres(d), d < 0 ? kZones[2] : kCues.distance);
      if (apart !== undefined) {
        const [a, b] = [at(apart.p_a), at(apart.p_b)];
        const S_p = length(apart.S_p);
        this.aparts[k]!.set(a, b, S_p > 0 && S_p < 1e11, `${millimetres(a.distanceTo(b))}, S_p ${millimetres(S_p)}`, kZones[length(apart.zone)] ?? kZones[2]);
      }
      return `${name}: ${d < 1e11 ? `${short(d)} m` : 'nobody is near'}`;
    });
  }
}
