import { element } from './dom';
import type { Light } from './format';
import type { Recording } from './recording';

const kZones = ['clear', 'slow', 'stop'];

/// A traffic light for each robot that a monitor slows: red above, amber, green below.
export class Lights {
  readonly panel = element('div', { class: 'lights' });
  private readonly shown: { light: Light; box: HTMLElement; word: HTMLElement }[] = [];
  constructor(
    lights: Light[],
    private readonly recording: Recording,
  ) {
    for (const light of lights) {
      const word = element('span', { class: 'word' });
      const lamps = element('span', { class: 'lamps' }, ...[2, 1, 0].map((zone) => element('i', { 'data-of': String(zone) })));
      const box = element('div', { class: 'light' }, lamps, element('span', {}, light.name.split('.').at(-1)!), word);
      this.panel.append(box);
      this.shown.push({ light, box, word });
    }
    this.panel.hidden = lights.length === 0;
  }
  update(row: number): void {
    for (const { light, box, word } of this.shown) {
      const zone = this.recording.values(light.zone)?.[0]![row];
      const text = zone === undefined ? '' : (kZones[zone] ?? '');
      if (word.textContent === text) continue;
      word.textContent = text;
      box.dataset['zone'] = text;
    }
  }
}
