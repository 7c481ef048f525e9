import * as three from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { style_colour } from './colours';
import { round_down } from './dom';
import { aim_at, type Aim, type Seen } from './framing';

/// Whether the processor draws, without a graphics card: smooth edges would cost it most of its time.
function draws_in_software(): boolean {
  const gl = document.createElement('canvas').getContext('webgl2');
  if (gl === null) return false;
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  const renderer = String(gl.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(renderer);
}

/// The 3D view: camera and ground. It draws only when something has changed. Where drawing is slow (no graphics card), it draws fewer pixels
/// while the time runs.
export class Stage {
  readonly scene = new three.Scene();
  readonly camera = new three.PerspectiveCamera(40, 1, 0.01, 200);
  readonly renderer: three.WebGLRenderer;
  private readonly controls: OrbitControls;
  private readonly ground = new three.Group();
  private dirty = true;
  private scale = 1;
  private slow = 0;
  private moving = false;
  private width = 0;
  private height = 0;
  /// Whether the camera is where the user or a link has put it.
  chosen = false;
  private seen?: Seen;
  /// Edge of all that there is, m.
  private extent = 1;
  /// Height of the view that was chosen last, not by hand, at the point that the camera looks at, m.
  span = 1;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new three.WebGLRenderer({ canvas, antialias: !draws_in_software() });
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener('change', () => this.invalidate());
    this.controls.addEventListener('start', () => (this.chosen = true));
    this.scene.add(this.ground);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    this.resize();
    window.addEventListener('resize', () => {  // a phone is turned
      this.resize();
      if (!this.chosen && this.seen !== undefined) this.look_at(this.seen);
    });
  }

  /// Sets background and ground to the colours of the style sheet. The ground is a grid below `all`, with whole metres or parts of them on its lines;
  /// `least`: half of its edge, m.
  dress(all: three.Box3, least: number): void {
    this.scene.background = new three.Color(style_colour('--stage'));
    const size = all.getSize(new three.Vector3());
    this.extent = Math.max(size.length(), 1);
    const metres = Math.max(least, 0.55 * Math.max(size.x, size.y));
    const spacing = Math.max(0.5, round_down(metres / 4));
    const lines = Math.ceil(metres / spacing) + 1;
    const line = style_colour('--grid');
    const grid = new three.GridHelper(2 * lines * spacing, 2 * lines, line, line);
    grid.rotation.x = Math.PI / 2;
    const centre = all.getCenter(new three.Vector3());
    grid.position.set(Math.round(centre.x / spacing) * spacing, Math.round(centre.y / spacing) * spacing, all.min.z - 0.001);
    this.ground.clear();
    this.ground.add(grid);
    this.invalidate();
  }

  /// Robots, the ways of their tips and what is near them come into view, also when the window gets another size, until `chosen`.
  look_at(seen: Seen): void {
    this.seen = seen;
    this.aim(aim_at(seen, this.camera.aspect, this.slope));
  }

  private get slope(): number {
    return Math.tan((this.camera.fov * Math.PI) / 360);
  }

  /// Position of the camera and the point that it looks at, m.
  get view(): number[] {
    return [...this.camera.position.toArray(), ...this.controls.target.toArray()];
  }
  set view([x, y, z, ...target]: number[]) {
    this.aim({ position: new three.Vector3(x, y, z), target: new three.Vector3(...target) });
    this.chosen = true;
  }

  private aim({ position, target }: Aim): void {
    const distance = position.distanceTo(target);
    this.span = 2 * this.slope * distance;
    this.camera.position.copy(position);
    this.camera.near = distance / 100;
    this.camera.far = 20 * Math.max(distance, this.extent);
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(target);
    this.controls.update();
    this.invalidate();
  }

  invalidate(): void {
    this.dirty = true;
  }

  /// Draws if something has changed. `elapsed`: seconds since the last frame, while the animation runs, otherwise 0.
  draw(elapsed: number): void {
    if (elapsed > 0) this.adapt(elapsed);
    if (elapsed > 0 !== this.moving) {
      this.moving = elapsed > 0;
      this.resize(true);
    }
    if (!this.dirty) return;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
  }

  /// A second of frames longer than 1/32 s: 0.7 times the pixels per edge, down to 0.35.
  private adapt(elapsed: number): void {
    this.slow = elapsed > 1 / 32 ? this.slow + elapsed : Math.max(0, this.slow - elapsed);
    if (this.slow < 1 || this.scale < 0.5) return;
    this.slow = 0;
    this.scale *= 0.7;
    this.resize(true);
  }

  private resize(force = false): void {
    const box = (this.canvas.parentElement ?? this.canvas).getBoundingClientRect();
    const [width, height] = [Math.max(1, Math.floor(box.width)), Math.max(1, Math.floor(box.height))];
    if (!force && width === this.width && height === this.height) return;
    this.width = width;
    this.height = height;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2) * (this.moving ? this.scale : 1));
    this.renderer.setSize(width, height, false);
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
  }
}
