/// Makes an element. Texts become text, never markup.
export function element<K extends keyof HTMLElementTagNameMap>(
  kind: K,
  attributes: Record<string, string> = {},
  ...content: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...content);
  return made;
}

export function button(label: string, title: string, action: () => void): HTMLButtonElement {
  const made = element('button', { type: 'button', title, 'aria-label': title }, label);
  made.addEventListener('click', action);
  return made;
}

/// A number for people: `digits` significant ones, with an exponent below 0.001 and from 100 000 on.
export function short(x: number, digits = 4): string {
  if (Number.isNaN(x)) return 'NaN';
  if (!Number.isFinite(x)) return x > 0 ? '∞' : '-∞';
  if (x === 0) return '0';
  const rounded = x.toExponential(digits - 1);
  const power = Number(rounded.slice(rounded.indexOf('e') + 1));
  return power < -3 || power > 4 ? rounded.replace('+', '') : x.toFixed(Math.max(0, digits - 1 - power));
}

/// The ticks of an axis, with as many digits as tell them apart.
export function tick_labels(ticks: number[]): string[] {
  const step = Math.min(...ticks.slice(1).map((t, i) => Math.abs(t - ticks[i]!)));
  const powers = Math.floor(Math.log10(Math.max(...ticks.map(Math.abs)))) - Math.floor(Math.log10(step));
  const digits = Number.isFinite(powers) ? Math.min(Math.max(powers + 2, 1), 15) : 6;
  return ticks.map((t) => short(Math.abs(t) < 1e-6 * step && Number.isFinite(step) ? 0 : t, digits).replace(/(\.\d*?)0+(?=e|$)/, '$1').replace(/\.(?=e|$)/, ''));
}

/// A number of 1, 2 or 5 times a power of ten, at most x.
export function round_down(x: number): number {
  const power = 10 ** Math.floor(Math.log10(x));
  const head = x / power;
  return (head >= 5 ? 5 : head >= 2 ? 2 : 1) * power;
}
