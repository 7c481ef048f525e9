import type { FigureView } from './figures';
import { between, type Recording } from './recording';
import { TipCalculator, frame_stiffness, joint_stiffness, velocity_of } from './tip';

/// Symmetric 3×3 matrices of the robots' tips over time, as xx xy xz yy yz zz in the axes of the robots' bases.
export interface Matrices {
  /// Makes a name ready.
  load(name: string): Promise<unknown>;
  /// undefined: there is none.
  at(name: string, t: number): number[] | undefined;
  /// About `most` of them over the whole time.
  some(name: string, most: number): number[][];
}

/// Those that are in the page with the recording. That of the nearest row is taken: one between two singular ones would not be singular.
export class RecordedMatrices implements Matrices {
  constructor(private readonly table: Recording) {}

  load(name: string): Promise<unknown> {
    return this.table.load(name);
  }
  at(name: string, t: number): number[] | undefined {
    const row = this.table.nearest(t);
    return this.table.values(name)?.map((column) => column[row]!);
  }
  some(name: string, most: number): number[][] {
    const columns = this.table.values(name);
    if (columns === undefined) return [];
    const stride = Math.max(1, Math.floor(this.table.rows / most));
    return Array.from({ length: Math.ceil(this.table.rows / stride) }, (_, i) => columns.map((column) => column[i * stride]!));
  }
}

/// Those of a run that goes on, calculated when they are asked for.
export class LiveMatrices implements Matrices {
  private readonly known = new Map<string, { calculator: TipCalculator; view: FigureView; what: string }>();

  constructor(
    private readonly recording: Recording,
    views: FigureView[],
  ) {
    for (const view of views) {
      const calculator = new TipCalculator(view.robot, view.figure.floats === true);
      const { mobility, velocity, stiffness } = view.figure;
      if (mobility !== '') this.known.set(mobility, { calculator, view, what: 'mobility' });
      if (velocity !== '') this.known.set(velocity, { calculator, view, what: 'velocity' });
      for (const name of stiffness.signals) this.known.set(name, { calculator, view, what: 'stiffness' });
    }
  }

  async load(name: string): Promise<unknown> {
    const found = this.known.get(name);
    const signal = found?.what === 'stiffness' ? found.view.figure.controller?.signal : undefined;
    return signal === undefined ? true : this.recording.load(signal);
  }
  at(name: string, t: number): number[] | undefined {
    const found = this.known.get(name);
    if (found === undefined) return undefined;
    const { calculator, view, what } = found;
    const place = this.recording.place(t);
    const values = (signal: string): number[] | undefined => (this.recording.rows === 0 ? undefined : this.recording.values(signal)?.map((column) => between(column, place)));
    const recorded = values(view.main.track.signal);
    const state = calculator.at(view.main.q.map((q, i) => (Number.isFinite(recorded?.[i]) ? recorded![i]! : q)));
    if (what === 'mobility') return state.mobility;
    if (what === 'velocity') return velocity_of(state);
    const controller = view.figure.controller;
    const S = controller === undefined ? undefined : values(controller.signal);
    if (controller === undefined || S === undefined || S.some((x) => !Number.isFinite(x))) return undefined;
    if (controller.joints) return joint_stiffness(state, S);
    return frame_stiffness(state, S.length === 9 ? [S[0]!, S[4]!, S[8]!] : S, controller.in_tool);
  }
  some(name: string, most: number): number[][] {
    const { rows, time } = this.recording;
    const count = Math.min(rows, most, 40);
    const all: number[][] = [];
    for (let k = 0; k < count; ++k) {
      const matrix = this.at(name, time[count > 1 ? Math.round((k * (rows - 1)) / (count - 1)) : 0]!);
      if (matrix !== undefined) all.push(matrix);
    }
    return all;
  }
}
