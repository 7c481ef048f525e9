import * as three from 'three';
import { kCues } from './colours';
import type { Cue, Scenery } from './cues';
import { short } from './dom';
import { matte } from './materials';
import type { Place } from './recording';

/// The line between two nearest points, with its length beside it.
class Measure {
  readonly group = new three.Group();
  private readonly line: three.Mesh;
  private readonly ends: three.Mesh[];
  private readonly label = new three.Sprite(new three.SpriteMaterial({ depthTest: false }));
  private readonly canvas = document.createElement('canvas');
  private text = '';
  constructor(size: number) {
    const material = matte({ color: kCues.distance });
    this.line = new three.Mesh(new three.CylinderGeometry(0.007 * size, 0.007 * size, 1, 8), material);
    this.ends = [0, 1].map(() => new three.Mesh(new three.SphereGeometry(0.016 * size, 12, 8), material));
    [this.canvas.width, this.canvas.height] = [256, 64];
    this.label.material.map = new three.CanvasTexture(this.canvas);
    this.label.material.map.colorSpace = three.SRGBColorSpace;
    this.label.scale.set(0.44 * size, 0.11 * size, 1);
    this.group.add(this.line, ...this.ends, this.label);
  }
  /// Distances in m; 1e12 stands for none.
  set(a: three.Vector3, b: three.Vector3, distance: number): void {
    this.group.visible = distance < 1e11 && Number.isFinite(a.length() + b.length());
    if (!this.group.visible) return;
    const way = b.clone().sub(a);
    this.line.position.copy(a).addScaledVector(way, 0.5);
    this.line.scale.set(1, Math.max(way.length(), 1e-6), 1);
    this.line.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), way.length() > 0 ? way.normalize() : new three.Vector3(0, 1, 0));
    this.ends[0]!.position.copy(a);
    this.ends[1]!.position.copy(b);
    this.label.position.copy(this.line.position).add(new three.Vector3(0, 0, 0.6 * this.label.scale.y));
    this.relabel(`${(1000 * distance).toFixed(Math.abs(distance) < 0.01 ? 1 : 0)} mm`);
  }
  private relabel(text: string): void {
    if (text === this.text) return;
    this.text = text;
    const context = this.canvas.getContext('2d')!;
    context.clearRect(0, 0, 256, 64);
    context.font = '600 44px system-ui, sans-serif';
    context.textAlign = 'center';
    const width = context.measureText(text).width + 24;
    context.fillStyle = 'rgba(255, 255, 255, 0.85)';
    context.fillRect(128 - width / 2, 4, width, 56);
    context.fillStyle = kCues.distance;
    context.fillText(text, 128, 48);
    this.label.material.map!.needsUpdate = true;
  }
}

/// Distances that a monitor measures.
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
  constructor(
    private readonly s: Scenery,
    private readonly size: number,
  ) {
    this.lacks = s.data.distances_lack;
    this.needs = s.data.distances.flatMap((source) => [source.p_a, source.p_b, source.distance]);
  }
  build(): void {
    for (const source of this.s.data.distances) {
      if (this.s.recording.values(source.p_a)?.length !== 3) continue;
      this.measures.push(new Measure(this.size));
      this.group.add(this.measures.at(-1)!.group);
    }
    this.s.scene.add(this.group);
  }
  show(on: boolean): void {
    this.group.visible = on;
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
    return shown.map(({ name, p_a, p_b, distance }, k) => {
      const d = length(distance);
      this.measures[k]!.set(at(p_a), at(p_b), d);
      return `${name}: ${d < 1e11 ? `${short(d)} m` : 'nobody is near'}`;
    });
  }
}
