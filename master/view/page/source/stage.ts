import * as three from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { style_colour } from './colours';

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

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new three.WebGLRenderer({ canvas, antialias: !draws_in_software() });
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener('change', () => this.invalidate());
    this.scene.add(this.ground);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    this.resize();
  }

  /// Sets background and ground to the colours of the style sheet. `extent`: half of the edge of the ground, `height`: its z, m.
  dress(extent: number, height: number): void {
    this.scene.background = new three.Color(style_colour('--stage'));
    this.ground.clear();
    const metres = Math.max(1, Math.ceil(extent));
    const spacing = metres > 20 ? 10 : metres > 4 ? 1 : 0.5;
    const edge = Math.ceil(metres / spacing) * spacing;
    const line = style_colour('--grid');
    const grid = new three.GridHelper(2 * edge, Math.round((2 * edge) / spacing), line, line);
    grid.rotation.x = Math.PI / 2;
    grid.position.z = height - 0.001;
    this.ground.add(grid);
    this.invalidate();
  }

  /// Puts everything within the box into view.
  look_at(box: three.Box3): void {
    const centre = box.getCenter(new three.Vector3());
    const half = box.getSize(new three.Vector3()).multiplyScalar(0.5).max(new three.Vector3(0.15, 0.15, 0.15));
    const back = new three.Vector3(0.95, -1.15, 0.6).normalize();
    const right = new three.Vector3().crossVectors(this.camera.up, back).normalize();
    const up = new three.Vector3().crossVectors(back, right);
    const slope = Math.tan((this.camera.fov * Math.PI) / 360);
    let distance = 0; // at which each corner is inside the picture
    for (let k = 0; k < 8; ++k) {
      const corner = new three.Vector3(k & 1 ? half.x : -half.x, k & 2 ? half.y : -half.y, k & 4 ? half.z : -half.z);
      const aside = Math.max(Math.abs(corner.dot(up)), Math.abs(corner.dot(right)) / this.camera.aspect);
      distance = Math.max(distance, corner.dot(back) + (1.08 * aside) / slope);
    }
    this.camera.position.copy(centre).addScaledVector(back, distance);
    this.camera.near = distance / 100;
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(centre);
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
