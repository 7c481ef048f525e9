// Tests without a browser: unpacking, decimation, kinematics, time.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Box3, Color, Matrix4, Vector3, type InstancedMesh } from 'three';
import { Instances } from '../source/instances';
import { usual_largest } from '../source/cues';
import { Extremes, decimate } from '../source/decimate';
import { round_down, short, tick_labels } from '../source/dom';
import { Shown } from '../source/figures';
import { element_name, type Robot, type Visual } from '../source/format';
import { aim_at, corners_of } from '../source/framing';
import { Mechanism, frame_pose, reach_of } from '../source/kinematics';
import { read_view, write_view } from '../source/link';
import { without_images } from '../source/meshes';
import { from_base64, integers, long_integers, numbers } from '../source/packed';
import { Player } from '../source/player';
import { RecordedMatrices } from '../source/matrices';
import { Scales, between, last_not_above, type Recording } from '../source/recording';
import { mass_along, principal_of, principal_of_product, quadratic } from '../source/symmetric';

/// The bytes of integers as master/view/packer.cpp writes them: differences of an order, sign in the lowest bit, low bytes first.
function bytes_of(values: number[], order: number, width: number): Uint8Array {
  let list = values.map(BigInt);
  for (let k = 0; k < order; ++k) list = list.map((value, i) => value - (i > 0 ? list[i - 1]! : 0n));
  const bytes = new Uint8Array(width * list.length);
  list.forEach((value, i) => {
    let u = value < 0n ? -2n * value - 1n : 2n * value;
    for (let k = 0; k < width; ++k, u >>= 8n) bytes[k * list.length + i] = Number(u & 255n);
  });
  return bytes;
}

test('integers come back from differences of every order', () => {
  const values = [5, -3, 0, 8388608, -8388608, 7, 7, 7];
  for (const order of [0, 1, 2]) assert.deepEqual([...integers(bytes_of(values, order, 4), values.length, order)], values);
});

test('times of a month in nanoseconds come back exactly', () => {
  const values = [0, 1_000_000, 2_000_000, 2_592_000_000_000_000, 2_592_000_000_000_001];
  for (const order of [0, 1, 2]) assert.deepEqual([...long_integers(bytes_of(values, order, 7), values.length, order)], values);
});

test('steps have gaps where the recording has no number', () => {
  const packed = { at: 0, size: 0, count: 5, kind: 'steps', order: 1, least: -1, step: 0.5, gaps: [[1, 2, 0], [4, 1, -1]] } as const;
  const values = numbers(bytes_of([0, 0, 0, 4, 4], 1, 4), structuredClone(packed) as never);
  assert.deepEqual([...values], [-1, NaN, NaN, 1, -Infinity]);
});

test('float32 comes back to the last bit, whatever its sign', () => {
  const wanted = new Float32Array([0, -0, 1.5, -1.5, 1e-30, -3e38, NaN, Infinity]);
  const bits = [...new Int32Array(wanted.buffer)].map((b) => (b < 0 ? b ^ 0x7fffffff : b));
  const values = numbers(bytes_of(bits, 0, 4), { at: 0, size: 0, count: bits.length, kind: 'float', order: 0 });
  assert.deepEqual(new Int32Array(values.buffer as ArrayBuffer), new Int32Array(wanted.buffer));
});

test('a stream of another length is an error', () => {
  // Far from 0 beside its steps, and beyond float32.
  const steps = { at: 0, size: 0, count: 3, kind: 'steps', order: 0 } as const;
  assert.deepEqual([...numbers(bytes_of([0, 1, 2], 0, 4), { ...steps, least: 1234.5, step: 2 ** -40 })], [1234.5, 1234.5 + 2 ** -40, 1234.5 + 2 ** -39]);
  assert.deepEqual([...numbers(bytes_of([0, 0, 0], 0, 4), { ...steps, least: 1e300, step: 1 })], [1e300, 1e300, 1e300]);
  assert.deepEqual(new Extremes(Float64Array.from({ length: 40 }, (_, i) => 1e300 * (i - 20))).range(0, 40), [-2e301, 1.9e301]);
  assert.throws(() => numbers(new Uint8Array(9), { at: 0, size: 0, count: 2, kind: 'steps', order: 0 }), /9 bytes for 2 numbers/);
});

test('base64 has all values of a byte', () => {
  const bytes = Uint8Array.from({ length: 255 }, (_, i) => i + 1);
  assert.deepEqual(from_base64(Buffer.from(bytes).toString('base64')), bytes);
});

test('the least and largest values of blocks are those of their numbers', () => {
  const values = Float32Array.from({ length: 5000 }, (_, i) => Math.sin(i * i));
  values[1234] = NaN;
  values[77] = 9;
  const extremes = new Extremes(values);
  for (const [begin, end] of [[0, 5000], [17, 4001], [100, 101], [70, 80], [1234, 1235], [300, 300], [255, 513]] as const) {
    const finite = [...values.subarray(begin, end)].filter((x) => !Number.isNaN(x));
    assert.deepEqual(extremes.range(begin, end), [Math.min(...finite), Math.max(...finite)]);
  }
});

test('a plot of a million rows keeps a single peak', () => {
  const n = 1_000_000;
  const values = new Float32Array(n);
  values[654_321] = 7;
  const time = Float64Array.from({ length: n }, (_, i) => i / 1000);
  const drawn = decimate(time, [new Extremes(values)], [values], 0, n, 600);
  assert.equal(drawn.t.length, 1200);
  assert.equal(Math.max(...(drawn.values[0] as number[])), 7);
  assert.ok(drawn.t.every((t, i) => i === 0 || t >= drawn.t[i - 1]!));
});

test('few rows are drawn as they are, with gaps for what is no number', () => {
  const values = Float32Array.from([1, NaN, 3, Infinity]);
  const drawn = decimate(Float64Array.from([0, 1, 2, 3]), [new Extremes(values)], [values], 0, 4, 100);
  assert.deepEqual(drawn, { t: [0, 1, 2, 3], values: [[1, null, 3, null]] });
});

const kArm: Robot = {
  name: 'arm',
  n: 2,
  joints: [
    { name: 'a', type: 'revolute', parent: -1, p: [0, 0, 1], quat: [1, 0, 0, 0], axis: [0, 0, 1], leader: 0, multiplier: 1, offset: 0, min: -1, max: 1 },
    { name: 'b', type: 'prismatic', parent: 0, p: [2, 0, 0], quat: [Math.SQRT1_2, 0, 0, Math.SQRT1_2], axis: [1, 0, 0], leader: 1, multiplier: 1, offset: 0, min: 0, max: 3 },
    { name: 'c', type: 'revolute', parent: 1, p: [0, 0, 0], quat: [1, 0, 0, 0], axis: [0, 0, 1], leader: 0, multiplier: -2, offset: 0.5, min: null, max: null },
  ],
  order: [0, 1, 2],
  frames: [{ name: 'tool', body: 2, p: [1, 0, 0], quat: [1, 0, 0, 0] }],
  tip: 0,
  names: ['a', 'b'],
  visuals: [[], [], [], []],
  solids: [[], [], [], []],
};

test('a turn, a slide and a mimic joint place the tool', () => {
  const mechanism = new Mechanism(kArm);
  const poses = mechanism.bodies();
  const [a, b] = [0.3, 0.7];
  mechanism.place([a, b], poses);
  const tool = frame_pose(kArm, 0, poses).elements;
  // The slide goes along y of the first body, the mimic turns by 0.5 - 2a about z after the quarter turn.
  const turn = a + Math.PI / 2 + 0.5 - 2 * a;
  const wanted = [2 * Math.cos(a) - b * Math.sin(a) + Math.cos(turn), 2 * Math.sin(a) + b * Math.cos(a) + Math.sin(turn), 1];
  wanted.forEach((x, i) => assert.ok(Math.abs(tool[12 + i]! - x) < 1e-12));
  assert.equal(reach_of(kArm), 1 + 0 + 2 + 3 + 1);
  assert.ok(poses.every((pose) => pose instanceof Matrix4));
});

test('a ghost of another world has its own base, where it is recorded along its way', () => {
  const moving = { base: { p: [0, 0, 0.7], quat: [1, 0, 0, 0] }, base_p: 'fixed.base_p', base_quat: '' } as const;
  const values = (name: string): Float32Array[] | undefined => (name === 'fixed.base_p' ? [[1, 2], [3, 4], [5, 6]].map((column) => new Float32Array(column)) : undefined);
  const recording = { values, signal: () => undefined } as unknown as Recording;
  const place = { row: 0, next: 1, share: 0.5 };
  const of_figure = new Matrix4().makeTranslation(9, 9, 9);
  const origin = (track: object): number[] => {
    const shown = new Shown(new Mechanism(kArm), { role: 'other', signal: 'q', ...track }, [], [], recording);
    shown.place(place, of_figure);
    return shown.group.matrix.toArray().slice(12, 15);
  };
  assert.deepEqual(origin({}), [9, 9, 9]);
  assert.deepEqual(origin(moving), [1.5, 3.5, 5.5]);
  assert.deepEqual(origin({ ...moving, base_p: '' }), [0, 0, 0.7]);
});

test('bodies of one shape are one mesh, each at its place with its size and colour', () => {
  const turned: [number, number, number, number] = [Math.SQRT1_2, 0, 0, Math.SQRT1_2]; // by 90° about z
  const box: Visual = { kind: 'box', size: [2, 4, 6], p: [1, 0, 0], quat: turned };
  const instances = new Instances();
  const blue = new Color('#0000ff');
  const first = instances.add(box, blue);
  const second = instances.add({ ...box, colour: [1, 0, 0, 1] }, blue);
  const rod = instances.add({ kind: 'cylinder', size: [0.5, 3, 0], p: [0, 0, 0], quat: [1, 0, 0, 0] }, blue);
  const egg = instances.add({ kind: 'ellipsoid', size: [1, 2, 3], p: [0, 0, 0], quat: [1, 0, 0, 0] }, blue);
  instances.build();
  assert.deepEqual(instances.group.children.map((mesh) => (mesh as InstancedMesh).count), [2, 1, 1]);
  instances.place(first, new Matrix4());
  instances.place(second, new Matrix4().makeTranslation(0, 0, 10));
  instances.place(rod, new Matrix4());
  instances.place(egg, new Matrix4());
  const near = (member: ReturnType<Instances['add']>, low: number[], high: number[]): void => {
    const found = instances.box(member);
    // The corners of the round shapes are on the circle, not all of them on the axes.
    assert.ok(found.min.distanceTo(new Vector3(...low)) < 0.05 && found.max.distanceTo(new Vector3(...high)) < 0.05, JSON.stringify(found));
  };
  near(first, [-1, -1, -3], [3, 1, 3]);
  near(second, [-1, -1, 7], [3, 1, 13]);
  near(rod, [-0.5, -0.5, -1.5], [0.5, 0.5, 1.5]);
  near(egg, [-1, -2, -3], [1, 2, 3]);
  const colours = (instances.group.children[0] as InstancedMesh).instanceColor!.array;
  assert.deepEqual([...colours], [0, 0, 1, 1, 0, 0]);
  assert.ok(!Instances.takes({ ...box, colour: [1, 0, 0, 0.5] }) && !Instances.takes({ ...box, kind: 'capsule' }));
});

test('principal directions of a symmetric matrix', () => {
  const m = [4, 1, -2, 3, 0.5, 6];
  const { values, axes } = principal_of(m);
  assert.ok(values[0] >= values[1] && values[1] >= values[2]);
  assert.ok(Math.abs(values[0] + values[1] + values[2] - 13) < 1e-12);
  axes.forEach((axis, i) => assert.ok(Math.abs(quadratic(m, axis) - values[i]!) < 1e-12));
  const [x, y, z] = axes as unknown as [number[], number[], number[]];
  assert.ok(Math.abs(x[0]! * (y[1]! * z[2]! - y[2]! * z[1]!) + x[1]! * (y[2]! * z[0]! - y[0]! * z[2]!) + x[2]! * (y[0]! * z[1]! - y[1]! * z[0]!) - 1) < 1e-12);
  assert.deepEqual(principal_of([1, 0, 0, 2, 0, 3]).values, [3, 2, 1]);
});

test('a singular matrix has an infinite mass and no volume, also after rounding', () => {
  // v vᵀ + w wᵀ of rank 2, rounded as packed numbers are; nothing moves along (1, 2, 2)/3.
  const [v, w] = [
    [0.8, -0.8, 0.4],
    [0.2, 0.4, -0.5],
  ];
  const rounded = [0, 1, 2, 4, 5, 8].map((k) => Math.fround(v![Math.floor(k / 3)]! * v![k % 3]! + w![Math.floor(k / 3)]! * w![k % 3]!) * (1 + 1e-7));
  rounded[0]! += 2e-7;
  assert.equal(principal_of_product(rounded).values[2], 0);
  assert.ok(principal_of_product(rounded).values[1] > 0.1);
  assert.equal(mass_along(rounded, [1 / 3, 2 / 3, 2 / 3]), Infinity);
  assert.ok(Math.abs(mass_along([2, 0, 0, 4, 0, 1e-4], [0, 0, 1]) - 1e4) < 1e-6);
});

test('between two singular rows the matrix is that of the nearest one', () => {
  const columns = [[1, 0], [0, 0], [0, 0], [0, 1], [0, 0], [0, 0]].map((column) => Float32Array.from(column));
  const table = { nearest: (t: number) => (t < 0.5 ? 0 : 1), values: () => columns } as unknown as Recording;
  const matrices = new RecordedMatrices(table);
  assert.deepEqual(matrices.at('tip', 0.4), [1, 0, 0, 0, 0, 0]);
  assert.deepEqual(matrices.at('tip', 0.6), [0, 0, 0, 1, 0, 0]);
});

test('the time stays within the recording and stops at its end', () => {
  const player = new Player(1, 3);
  player.seek(99);
  assert.equal(player.time, 3);
  player.toggle();
  assert.equal(player.time, 1);
  player.change_speed(1);
  assert.equal(player.speed, 2);
  assert.ok(player.advance(0.25));
  assert.equal(player.time, 1.5);
  player.advance(10);
  assert.equal(player.time, 3);
  assert.equal(player.playing, false);
  player.seek(NaN);
  assert.equal(player.time, 3);
  for (let i = 0; i < 50; ++i) player.change_speed(-1);
  assert.equal(player.speed, Player.kSpeeds[0]);
});

test('rows are found by time, and a gap takes the number beside it', () => {
  assert.deepEqual([-1, 0, 0.5, 1, 7, 9].map((t) => last_not_above([0, 1, 1, 7], t)), [0, 0, 0, 2, 3, 3]);
  const column = Float32Array.from([1, 2, NaN]);
  assert.equal(between(column, { row: 0, next: 1, share: 0.25 }), 1.25);
  assert.equal(between(column, { row: 1, next: 2, share: 0.5 }), 2);
});

test('numbers for people', () => {
  const texts: [number, string][] = [
    [0, '0'], [-0, '0'], [1234.56, '1235'], [-7, '-7.000'], [12345.6, '12346'], [99999.4, '1.000e5'], [1e5, '1.000e5'], [0.001, '0.001000'], [0.00099999, '0.001000'],
    [-0.0005, '-5.000e-4'], [5e-6, '5.000e-6'], [1e-300, '1.000e-300'], [-1e300, '-1.000e300'], [NaN, 'NaN'], [Infinity, '∞'], [-Infinity, '-∞'],
  ];
  for (const [x, text] of texts) assert.equal(short(x), text);
  for (let power = -300; power <= 300; ++power) {
    for (const head of [1, -1.2345, 9.9999, 9.99951]) {
      const text = short(head * 10 ** power);
      assert.ok(Math.abs(Number(text) / (head * 10 ** power) - 1) < 6e-4 && text.length <= 11, text);
    }
  }
  assert.deepEqual([1, 4.9, 0.07, 600].map(round_down), [1, 2, 0.05, 500]);
  assert.equal(usual_largest([NaN, -1]), 1);
});

test('ticks of an axis are told apart, and have their signs and exponents', () => {
  const lists: [number[], string[]][] = [
    [[-5e-6, 0, 5e-6], ['-5e-6', '0', '5e-6']],
    [[-0.001, -0.0005, 1e-19, 0.0005], ['-0.001', '-5e-4', '0', '5e-4']],
    [[0, 2.5, 5, 7.5, 10, 12.5], ['0', '2.5', '5', '7.5', '10', '12.5']],
    [[10.1234567, 10.1234568], ['10.1234567', '10.1234568']],
    [[50000, 100000, 150000], ['50000', '1e5', '1.5e5']],
    [[0.1, 0.2, 0.30000000000000004], ['0.1', '0.2', '0.3']],
    [[-1e300, 1e300], ['-1e300', '1e300']],
    [[1e-300], ['1e-300']],
    [[0], ['0']],
    [[], []],
  ];
  for (const [ticks, texts] of lists) assert.deepEqual(tick_labels(ticks), texts);
  for (let power = -40; power <= 38; ++power) {
    const texts = tick_labels([0, 1, 2, 3].map((k) => 10 ** power * (1 + 0.25 * k)));
    assert.equal(new Set(texts).size, 4, texts.join());
  }
});

test('elements have the names of joints, axes or numbers', () => {
  const names = (name: string, unit: string, count: number, joints?: string[]): string => [...Array(count).keys()].map((i) => element_name({ name, unit, count, ...(joints && { joints }) }, i)).join(' ');
  assert.equal(names('drive.q', 'rad', 3, ['a', 'b', 'c']), 'a b c');
  assert.equal(names('world.block.p', 'm', 3), 'x y z');
  assert.equal(names('world.block.quat', '1', 4), 'w x y z');
  assert.equal(names('monitor.normal', '1', 3), 'x y z');
  assert.equal(names('world.contact_f', 'N', 6), '1 x 1 y 1 z 2 x 2 y 2 z');
  for (const [name, unit] of [['log.q', ''], ['drive.q', 'rad'], ['hand.K_h', 'N/m'], ['hand.x', 'm'], ['indices.kin_v_lengths', 'm/s'], ['ask.mass', 'kg']] as const) assert.equal(names(name, unit, 3), '[1] [2] [3]');
});

test('what is rounding beside the largest number of its unit is 0, and nothing else is', () => {
  const scales = new Scales({ N: 8.9, m: 1e12, rad: 3, '1': 1e5, s: 60 });
  assert.equal(scales.text(-1.3e-13, 'N.m'), '0'); // torques come from forces
  assert.equal(scales.text(5e-6, 'N.m'), '5.000e-6');
  assert.equal(scales.text(5e-6, 'm'), '5.000e-6'); // 1e12 is no length
  assert.equal(scales.text(1e-10, 'm'), '0');
  for (const unit of ['s', '1', '', 'W']) assert.equal(scales.text(1e-12, unit), '1.000e-12');
  scales.note('W', NaN);
  scales.note('W', -1000);
  assert.equal(scales.text(1e-7, 'W'), '0');
});

test('a link opens the view that it was made of, and what is bad in it is left out', () => {
  const view = { t: 2.5, range: [1, 3.25], camera: [1, -2, 0.5, 0, 0, 1e-3], cues: ['ghosts', 'mass'], plots: ['drive.q', 'a,b&c=#%'] };
  assert.deepEqual(read_view(`#${write_view(view)}`), view);
  assert.deepEqual(read_view(`#${write_view({ plots: [''] })}`), { plots: [''] });
  assert.equal(write_view({}), '');
  for (const bad of ['', '#', '#%', '#%E0%A4%A', '#t=', '#t=x', '#t=NaN', '#t=Infinity', '#t=1e300', '#t=1,2', '#range=3,1', '#range=1', '#camera=1,2,3', '#camera=1,1,1,1,1,1', '#camera=1,,1,1,1,2', '#hello', `#${'x'.repeat(1e5)}`]) assert.deepEqual(read_view(bad), {}, bad);
  assert.deepEqual(read_view('#t=x&cues=limits&range=0,2'), { range: [0, 2], cues: ['limits'] });
});

test('the camera has all robots in view, and what is near them', () => {
  const cube = (x: number, y: number, z: number, half: number): Vector3[] => corners_of(new Box3(new Vector3(x - half, y - half, z - half), new Vector3(x + half, y + half, z + half)));
  const slope = Math.tan(Math.PI / 9);
  for (const [aspect, place] of [[0.85, 0], [1.05, 1.2], [2.4, 3]] as const) {
    const [robots, near, far] = [[cube(0, 0, 0.5, 0.5), cube(place, 0.1, 0.5, 0.5)], cube(0.2, -1, 0.2, 0.2), cube(40, 3, 1, 2)];
    const { position, target } = aim_at({ robots, ways: [], bodies: [[near], [far]] }, aspect, slope);
    const back = position.clone().sub(target).normalize();
    const right = new Vector3(0, 0, 1).cross(back).normalize();
    const up = back.clone().cross(right);
    const inside = (points: Vector3[]): boolean => points.every((point) => {
      const way = point.clone().sub(position);
      const depth = -way.dot(back);
      return depth > 0 && Math.abs(way.dot(right)) <= depth * slope * aspect && Math.abs(way.dot(up)) <= depth * slope;
    });
    assert.ok(inside(robots.flat()) && inside(near) && !inside(far), `${aspect}`);
  }
  const { position, target } = aim_at({ robots: [cube(1, 2, 3, 0)], ways: [], bodies: [] }, 1, slope);
  assert.ok(Math.abs(position.distanceTo(target) - 0.3) < 1e-9 && target.distanceTo(new Vector3(1, 2, 3)) < 1e-9);
});

test('images are taken out of glTF, so that nothing is loaded', () => {
  const json = JSON.stringify({ asset: { version: '2.0' }, images: [{ uri: 'x.png' }], textures: [{}], materials: [{ pbrMetallicRoughness: { baseColorTexture: { index: 0 }, metallicFactor: 0 } }] });
  const plain = new TextDecoder().decode(without_images(new TextEncoder().encode(json), false));
  assert.deepEqual(JSON.parse(plain), { asset: { version: '2.0' }, materials: [{ pbrMetallicRoughness: { metallicFactor: 0 } }] });
});
