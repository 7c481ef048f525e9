// Tests without a browser of what a live page adds: a recording that grows, following it, sliders, matrices of the tip.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { matching, moments_of, slider_range } from '../source/controls';
import { Extremes } from '../source/decimate';
import type { Robot } from '../source/format';
import { LiveRecording } from '../source/live_recording';
import { Player } from '../source/player';
import { TimeWindow } from '../source/plots';
import { between } from '../source/recording';
import { TipCalculator, frame_stiffness, inverse_of, joint_stiffness, velocity_of } from '../source/tip';

const kSignals = [
  { name: 'a.q', unit: 'rad', first: 0, count: 2 },
  { name: 'a.on', unit: '', first: 2, count: 1 },
  { name: 'a.huge', unit: '', first: 3, count: 2000 },
];
const sample = (time_s: number, values: Record<string, never>): never => ({ tick: 0, time_s, values, lost: 0 }) as never;
const row = (time_s: number, values: object): never => sample(time_s, values as never);

async function loaded(capacity: number): Promise<LiveRecording> {
  const recording = new LiveRecording(kSignals, capacity);
  const all = Promise.all([recording.load('a.q'), recording.load('a.on')]);
  recording.take(row(0, { 'a.q': [0, 0], 'a.on': false }));
  await all;
  return recording;
}

test('a live recording orders signals once, and gives their numbers in the same arrays for ever', async () => {
  const recording = new LiveRecording(kSignals, 8);
  const orders: string[][] = [];
  recording.ordered = (names) => orders.push(names);
  const q = recording.load('a.q');
  void recording.load('a.q');
  assert.deepEqual(orders, [['a.q']]);
  const columns = recording.values('a.q')!;
  assert.ok(Number.isNaN(columns[0]![0]));
  recording.take(row(1, { 'a.q': [0.5, null] }));
  assert.equal(await q, true);
  for (let i = 2; i < 50; ++i) recording.take(row(i, { 'a.q': [i, -i] }));
  assert.equal(recording.values('a.q'), columns);
  assert.equal(await recording.load('nothing'), false);
  assert.equal(orders.length, 1);
});

test('when it is full it drops the older half, and what is kept is in order', async () => {
  const recording = await loaded(100);
  for (let i = 1; i < 1000; ++i) {
    recording.take(row(i, { 'a.q': [i, -i], 'a.on': i % 2 === 0 }));
    assert.ok(recording.rows <= 100 && recording.rows >= Math.min(i + 1, 50));
  }
  const [first, second] = recording.values('a.q')!;
  for (let k = 0; k < recording.rows; ++k) {
    assert.equal(recording.time[k], 1000 - recording.rows + k);
    assert.equal(first![k], recording.time[k]);
    assert.equal(second![k], -recording.time[k]!);
  }
  // What is behind the last row takes part in nothing.
  assert.deepEqual(recording.place(1e9), { row: recording.rows - 1, next: recording.rows - 1, share: 0 });
  assert.equal(between(first!, recording.place(998.5)), 998.5);
  assert.ok([...first!.subarray(recording.rows)].every(Number.isNaN));
  assert.equal(recording.taken, 1000);
});

test('values that were set in a pause replace the last row; an earlier time begins anew', async () => {
  const recording = await loaded(10);
  recording.take(row(1, { 'a.q': [1, 1], 'a.on': true }));
  recording.take(row(1, { 'a.q': [2, 2], 'a.on': false }));
  assert.equal(recording.rows, 2);
  assert.equal(recording.values('a.q')![0]![1], 2);
  assert.equal(recording.values('a.on')![0]![1], 0);
  recording.take(row(0.5, { 'a.q': [7, 7], 'a.on': true }));
  assert.equal(recording.rows, 1);
  assert.equal(recording.time[0], 0.5);
  assert.ok(Number.isNaN(recording.values('a.q')![0]![1]));
});

test('a signal that the message lacks, or whose number is none, is a gap', async () => {
  const recording = await loaded(10);
  recording.take(row(1, { 'a.q': [null, 3] }));
  assert.ok(Number.isNaN(recording.values('a.q')![0]![1]) && recording.values('a.q')![1]![1] === 3);
  assert.ok(Number.isNaN(recording.values('a.on')![0]![1]));
});

test('more than one stream can have is refused, and a stream that does not answer is not waited for', async () => {
  const recording = new LiveRecording(kSignals, 4);
  await assert.rejects(recording.load('a.huge'), /a\.huge is not shown/);
  assert.equal(recording.values('a.huge'), undefined);
  assert.equal(await recording.load('a.q', 10), true);
});

test('a plot of a growing recording reads the numbers as they are now', () => {
  const values = new Float32Array(1000).fill(NaN);
  const extremes = new Extremes(values, true);
  values.fill(1, 0, 500);
  values[400] = 5;
  assert.deepEqual(extremes.range(0, 500), [1, 5]);
  values[400] = 1;
  assert.deepEqual(extremes.range(0, 500), [1, 1]);
});

test('the player follows the newest time until somebody goes back', () => {
  const player = new Player(0, 0, true);
  player.grow(0, 1);
  assert.equal(player.time, 1);
  player.seek(0.5);
  player.grow(0, 2);
  assert.equal(player.time, 0.5);
  player.grow(0.75, 3);
  assert.equal(player.time, 0.75);
  player.toggle();
  assert.ok(player.playing && player.advance(0.25));
  assert.equal(player.time, 1);
  player.advance(100);
  assert.ok(player.following && !player.playing);
  player.grow(1, 4);
  assert.equal(player.time, 4);
  player.toggle(); // holds the picture
  player.grow(1, 5);
  assert.equal(player.time, 4);
  player.follow();
  assert.equal(player.time, 5);
});

test('the plots show the last seconds, as many as were chosen', () => {
  const range = new TimeWindow(0, 0);
  range.grow(0, 4, true);
  assert.deepEqual([range.from, range.to], [0, 4]);
  range.grow(0, 40, true);
  assert.deepEqual([range.from, range.to], [30, 40]);
  range.zoom(0.5, 40);
  range.grow(0, 41, true);
  assert.deepEqual([range.from, range.to], [36, 41]);
  range.grow(0, 50, false);
  assert.deepEqual([range.from, range.to], [36, 41]);
  range.all();
  range.grow(10, 60, true);
  assert.deepEqual([range.from, range.to], [10, 60]);
});

test('sliders have the bounds of the variable where they are near, otherwise a range about the start', () => {
  const range = (min: number | undefined, max: number | undefined, start: number, type: 'Real' | 'Integer' = 'Real'): [number, number] => {
    const found = slider_range({ type, ...(min === undefined ? {} : { min }), ...(max === undefined ? {} : { max }) }, start);
    return [found.min, found.max];
  };
  assert.deepEqual(range(0, 1, 0.5), [0, 1]);
  assert.deepEqual(range(0, undefined, 100), [0, 300]);
  assert.deepEqual(range(0, 1e6, 100), [0, 300]);
  assert.deepEqual(range(undefined, undefined, 0), [-10, 10]);
  assert.deepEqual(range(undefined, undefined, -4), [-12, 4]);
  assert.deepEqual(range(-1.5, 2.5, 0, 'Integer'), [-1, 2]);
  assert.deepEqual(range(undefined, undefined, NaN), [-10, 10]);
});

test('the filter takes words of name and description', () => {
  const signals = [{ name: 'drive.K', description: 'stiffness of the gears' }, { name: 'drive.B' }, { name: 'compliance.S_a', description: 'Stiffness' }];
  assert.deepEqual(matching(signals, 'STIFF drive').map((s) => s.name), ['drive.K']);
  assert.equal(matching(signals, ' ').length, 3);
  assert.equal(matching(signals, 'none').length, 0);
});

/// Two links of lengths a, b in the plane, point masses at their ends, and inertias about them.
const [a, b, m1, m2, i2] = [0.7, 0.4, 3, 2, 0.25];
const revolute = { type: 'revolute', quat: [1, 0, 0, 0], axis: [0, 0, 1], multiplier: 1, offset: 0, min: null, max: null } as const;
const kPlanar = {
  name: 'planar',
  n: 2,
  joints: [
    { name: 'a', parent: -1, p: [0, 0, 0], leader: 0, ...revolute },
    { name: 'b', parent: 0, p: [a, 0, 0], leader: 1, ...revolute },
  ],
  order: [0, 1],
  frames: [{ name: 'tool', body: 1, p: [b, 0, 0], quat: [1, 0, 0, 0] }],
  tip: 0,
  names: ['a', 'b'],
  visuals: [],
  solids: [],
  inertias: [
    { mass: m1, com: [a, 0, 0], inertia: [0, 0, 0, 0, 0, 0] },
    { mass: m2, com: [b, 0, 0], inertia: [0, 0, 0, 0, 0, i2] },
  ],
} as unknown as Robot;

test('Jacobian, mobility and stiffness of a planar arm are those of the formulas', () => {
  const [q1, q2] = [0.4, 1.1];
  const state = new TipCalculator(kPlanar).at([q1, q2]);
  const [s1, c1, s12, c12] = [Math.sin(q1), Math.cos(q1), Math.sin(q1 + q2), Math.cos(q1 + q2)];
  const J = [
    [-a * s1 - b * s12, -b * s12],
    [a * c1 + b * c12, b * c12],
  ];
  J.forEach((line, i) => line.forEach((x, k) => assert.ok(Math.abs(state.jacobian[i]![k]! - x) < 1e-12)));
  const coupling = m2 * (b * b + a * b * Math.cos(q2)) + i2;
  const M = [m1 * a * a + m2 * (a * a + b * b + 2 * a * b * Math.cos(q2)) + i2, coupling, m2 * b * b + i2] as const;
  const d = M[0] * M[2] - M[1] * M[1];
  const inverse = [M[2] / d, -M[1] / d, M[0] / d] as const;
  const term = (i: number, k: number): number => J[i]![0]! * (inverse[0] * J[k]![0]! + inverse[1] * J[k]![1]!) + J[i]![1]! * (inverse[1] * J[k]![0]! + inverse[2] * J[k]![1]!);
  const wanted = [term(0, 0), term(0, 1), 0, term(1, 1), 0, 0];
  wanted.forEach((x, i) => assert.ok(Math.abs(state.mobility![i]! - x) < 1e-12, `${i}: ${state.mobility![i]}, expected ${x}`));
  assert.ok(Math.abs(velocity_of(state)![1]! - (J[0]![0]! * J[1]![0]! + J[0]![1]! * J[1]![1]!)) < 1e-12);
  // Along the plane S = J⁻ᵀ S_a J⁻¹; across it the joints cannot move.
  const S = joint_stiffness(state, [100, 50]);
  const det = J[0]![0]! * J[1]![1]! - J[0]![1]! * J[1]![0]!;
  const wanted_xx = (100 * J[1]![1]! * J[1]![1]! + 50 * J[1]![0]! * J[1]![0]!) / (det * det);
  assert.ok(Math.abs(S[0]! / wanted_xx - 1) < 1e-5);
  assert.ok(Math.abs(S[5]! / 1e9 - 1) < 1e-6);
  assert.deepEqual(frame_stiffness(state, [1, 2, 3], false), [1, 0, 0, 2, 0, 3]);
  const turned = frame_stiffness(state, [1, 2, 3], true);
  assert.ok(Math.abs(turned[0]! - (c12 * c12 + 2 * s12 * s12)) < 1e-12 && Math.abs(turned[5]! - 3) < 1e-12);
});

test('a free base recoils', () => {
  // A slide along x on a base of 3 kg, a link of 1 kg; the tip is at the centre of mass of both, so that nothing turns.
  const slide = { ...kPlanar, n: 1, order: [0], names: ['x'], joints: [{ ...kPlanar.joints[0]!, type: 'prismatic', axis: [1, 0, 0] }], frames: [{ ...kPlanar.frames[0]!, body: 0, p: [0, 0, 0] }], tip: 0 };
  const robot = { ...slide, inertias: [{ mass: 1, com: [0, 0, 0], inertia: [1, 0, 0, 1, 0, 1] }], base_inertia: { mass: 3, com: [0, 0, 0], inertia: [2, 0, 0, 2, 0, 2] } } as unknown as Robot;
  const [free, fixed] = [new TipCalculator(robot, true).at([0]), new TipCalculator(robot).at([0])];
  const close = (found: number[], wanted: number[]): void => wanted.forEach((x, i) => assert.ok(Math.abs(found[i]! - x) < 1e-12, found.join(' ')));
  close(free.mobility!, [1, 0, 0, 1 / 4, 0, 1 / 4]);
  close(fixed.mobility!, [1, 0, 0, 0, 0, 0]);
  close(velocity_of(free)!, [9 / 16, 0, 0, 0, 0, 0]); // the base goes back by 1/4
  // A tip 0.5 m up turns the whole: 1/m + 0.5²/I across; along the slide the link gives way alone.
  const up = { ...robot, frames: [{ ...slide.frames[0]!, p: [0, 0, 0.5] }] } as unknown as Robot;
  close(new TipCalculator(up, true).at([0]).mobility!, [1 + 0.25 / 3, 0, 0, 1 / 4 + 0.25 / 3, 0, 1 / 4]);
});

test('a robot without masses has no mobility', () => {
  const { inertias: _, ...without } = kPlanar;
  assert.equal(new TipCalculator(without as Robot).at([0.1, 0.2]).mobility, undefined);
});

test('the inverse of a symmetric matrix', () => {
  const m = [4, 1, -2, 3, 0.5, 6];
  const i = inverse_of(m);
  assert.ok(Math.abs(m[0]! * i[0]! + m[1]! * i[1]! + m[2]! * i[2]! - 1) < 1e-12);
  assert.ok(Math.abs(m[0]! * i[1]! + m[1]! * i[3]! + m[2]! * i[4]!) < 1e-12);
});

test('events of one time are one moment, and the later of two on one variable counts', () => {
  const event = (time_s: number, name: string, value: number): { time_s: number; name: string; values: number[]; ramp_s: number } => ({ time_s, name, values: [value], ramp_s: 0 });
  const moments = moments_of([event(1, 'drive.tau_e', 5), event(2, 'a', 1), event(1, 'compliance.tau_e', 5), event(2, 'a', 3)]);
  assert.deepEqual(moments.map((moment) => moment.map(({ name, values }) => [name, values[0]])), [[['drive.tau_e', 5], ['compliance.tau_e', 5]], [['a', 3]]]);
});
