/// What a link keeps of a view, in the part of the URL behind #. What is absent is as the page begins.
export interface View {
  /// s
  t?: number;
  /// Shown range of the plots, s.
  range?: number[];
  /// Position of the camera and what it looks at, m.
  camera?: number[];
  /// Cues by their ids, plots by their signals.
  cues?: string[];
  plots?: string[];
}

const kFarthest = 1e6;

/// Parts that cannot be read are left out.
export function read_view(hash: string): View {
  const parts = new URLSearchParams(hash.replace(/^#/, ''));
  const numbers = (name: string, count: number): number[] | undefined => {
    const words = parts.get(name)?.split(',') ?? [];
    const values = words.map((word) => (word.trim() === '' ? NaN : Number(word)));
    return values.length === count && values.every((x) => Math.abs(x) <= kFarthest) ? values : undefined;
  };
  const [t, range, camera, cues] = [numbers('t', 1), numbers('range', 2), numbers('camera', 6), parts.get('cues')];
  return {
    ...(t !== undefined && { t: t[0]! }),
    ...(range !== undefined && range[0]! < range[1]! && { range }),
    ...(camera !== undefined && Math.hypot(...[0, 1, 2].map((i) => camera[i]! - camera[i + 3]!)) > 1e-3 && { camera }),
    ...(cues !== null && { cues: cues.split(',') }),
    ...(parts.has('plot') && { plots: parts.getAll('plot') }),
  };
}

export function write_view({ t, range, camera, cues, plots }: View): string {
  const numbers = (values: number[]): string => values.map((x) => String(+x.toPrecision(9))).join(',');
  const parts = new URLSearchParams();
  if (t !== undefined) parts.set('t', numbers([t]));
  if (range !== undefined) parts.set('range', numbers(range));
  if (camera !== undefined) parts.set('camera', numbers(camera));
  if (cues !== undefined) parts.set('cues', cues.join(','));
  for (const plot of plots ?? []) parts.append('plot', plot);
  return parts.toString().replaceAll('%2C', ',');
}
