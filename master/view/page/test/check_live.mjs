// check_live.mjs CHROMIUM URL PLAN.json RESULT.json [FOLDER]: opens the page of a run that goes on in Chromium, uses it as a person does, and ends the
// run. Writes one line per failure and ends with 1 if there is one. RESULT.json: what the page shows at some joint positions, for a comparison with
// calculations of another program. FOLDER: for screenshots. The plan is an object with
//   { title, q, controller: signals, cues: [ids that have data], slider: a real that can be set, bounded?: one whose values are bounded, event?: a planned
//     event, pulse?: an input, dark?, latency?: true: print how long a change takes until it is drawn }
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { Browser } from './browser.mjs';

const [chromium, url, plan_file, result_file, folder] = process.argv.slice(2);
const plan = JSON.parse(readFileSync(plan_file, 'utf8'));
let failures = 0;

function check(is_good, text) {
  if (is_good) return;
  ++failures;
  console.log(`live page: ${text}`);
}

/// What the gateway answers, asked beside the page.
const ask = async (path) => (await fetch(new URL(path, url))).json();
const value = async (name) => (await ask(`run/values?names=${encodeURIComponent(name)}`)).values[name];
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

async function until(condition, what) {
  for (const end = Date.now() + 60_000; !(await condition()); await pause(20)) {
    if (Date.now() > end) return check(false, `not within a minute: ${what}`);
  }
}

const browser = await Browser.start(chromium, { width: 1400, height: 860, dark: plan.dark === true });
const click = (label) => browser.evaluate(`(() => { const found = [...document.querySelectorAll('button')].find((b) => b.textContent === ${JSON.stringify(label)} && !b.disabled); found?.click(); return found !== undefined; })()`);
const shot = async (name) => {
  if (folder) writeFileSync(join(folder, `live_${name}.png`), await browser.screenshot());
};

/// Drags the handle of a slider by a part of its length with the mouse.
async function drag(name, share) {
  await browser.evaluate(`(() => { const box = document.querySelector('.settable[data-name=${JSON.stringify(name)}]'); box.open = true; box.scrollIntoView(); })()`);
  const slider = `document.querySelector('.settable[data-name=${JSON.stringify(name)}] input[type=range]')`;
  await browser.until(`${slider} !== null`);
  const box = await browser.evaluate(`(() => { const { left, top, width, height } = ${slider}.getBoundingClientRect(); return { left, top, width, height }; })()`);
  const [y, x] = [box.top + box.height / 2, (part) => box.left + part * box.width];
  await browser.mouse('mousePressed', x(0.5), y);
  for (const part of [0.5, (0.5 + share) / 2, share]) await browser.mouse('mouseMoved', x(part), y);
  await browser.mouse('mouseReleased', x(share), y);
  return browser.evaluate(`Number(document.querySelector('.settable[data-name=${JSON.stringify(name)}] .set input[type=number]').value)`);
}

try {
  await browser.open(url);
  check(await browser.evaluate("document.querySelector('.failure') === null"), `the page says: ${await browser.evaluate("document.querySelector('.failure')?.textContent ?? ''")}`);
  check((await browser.evaluate("document.querySelector('h1').textContent")) === plan.title, `the heading is not ${plan.title}`);
  await browser.until('cotwin.recording.rows > 20');
  check(await browser.evaluate('cotwin.player.following'), 'the page does not follow the run');
  check((await browser.evaluate("document.querySelector('.state').textContent")) === 'live', 'the state is not live');

  for (const id of plan.cues) {
    const entry = await browser.evaluate(`(() => { const cue = document.querySelector('.cue[data-cue="${id}"]'); return { off: cue.querySelector('input').disabled, key: cue.querySelector('kbd').textContent, text: cue.textContent }; })()`);
    check(!entry.off, `cue ${id} has no data: ${entry.text}`);
    if (entry.off) continue;
    await browser.key(entry.key);
    await browser.until(`cotwin.shown.has('${id}') && document.querySelector('[data-cue="${id}"]').textContent.length > ${entry.text.length}`);
    const text = await browser.evaluate(`document.querySelector('[data-cue="${id}"]').textContent`);
    check(!/NaN|undefined/.test(text), `cue ${id} shows no figures: ${text}`);
  }
  await browser.until('cotwin.plots.every((plot) => plot.chart.data[0].length > 10)');
  await shot('running');

  // The picture is not empty, and it changes.
  const pixels = `(() => { cotwin.stage.invalidate(); cotwin.stage.draw(0); const gl = cotwin.stage.renderer.getContext(); const all = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
    gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, all); const colours = new Set(); for (let i = 0; i < all.length; i += 4) colours.add((all[i] << 16) | (all[i + 1] << 8) | all[i + 2]); return colours.size; })()`;
  check((await browser.evaluate(pixels)) > 20, 'the 3D view is empty');

  // A pause stops the time of the run, on the page, too. Steps make as many ticks as they should.
  check(await click('pause'), 'there is no button pause');
  await until(async () => (await ask('run')).phase === 'paused', 'the run pauses');
  const paused = await ask('run');
  await browser.until(`cotwin.state.textContent === 'paused' && Math.abs(cotwin.time - ${paused.time_s}) < 1e-9`);
  await pause(300);
  check((await ask('run')).tick === paused.tick, 'the run goes on while it is paused');
  await browser.evaluate("(() => { const ticks = document.querySelector('.run input'); ticks.value = '7'; })()");
  check(await click('step'), 'there is no button step');
  await until(async () => (await ask('run')).tick === paused.tick + 7, 'seven ticks are made');
  const stepped = await ask('run');
  check(stepped.phase === 'paused', 'the run does not pause after the steps');
  await browser.until(`Math.abs(cotwin.time - ${stepped.time_s}) < 1e-9`);

  // What the page shows in the pause is what the run has.
  const shown = { time_s: stepped.time_s, q: await value(plan.q), S: await value(plan.controller), poses: await browser.evaluate('cotwin.poses(0)'), matrices: {} };
  for (const what of ['mobility', 'velocity', 'stiffness']) shown.matrices[what] = (await browser.evaluate(`cotwin.calculated.at('figure 0 ${what}', cotwin.time)`)) ?? null;
  const plotted = await browser.evaluate('cotwin.plot_values()');
  for (const [name, texts] of Object.entries(plotted)) {
    const now = [await value(name)].flat();
    now.forEach((x, i) => check(Math.abs(Number(texts[i]) - x) <= 6e-4 * Math.abs(x) + 1e-9, `the plot of ${name} shows ${texts[i]}, the run has ${x}`));
  }
  writeFileSync(result_file, JSON.stringify(shown));

  // A slider, an event of the scenario and a pulse change the run.
  const set = await drag(plan.slider, 0.75);
  await until(async () => [await value(plan.slider)].flat().every((x) => x === set), `${plan.slider} becomes ${set}`);
  const later = await drag(plan.slider, 0.6);
  check(later !== set, 'the slider does not move');
  await until(async () => [await value(plan.slider)].flat()[0] === later, `${plan.slider} becomes ${later}`);
  await shot('sliders');
  if (plan.event !== undefined) {
    const { names, values } = plan.event;
    const name = names[0];
    await browser.evaluate("document.querySelector('.events').open = true");
    check(await browser.evaluate(`(() => { const found = [...document.querySelectorAll('.event')].find((event) => event.textContent.includes(${JSON.stringify(name)})); found?.querySelector('button').click(); return found !== undefined; })()`), `there is no event ${name}`);
    for (const each of names) await until(async () => JSON.stringify([await value(each)].flat()) === JSON.stringify(values), `the event sets ${each}`);
  }
  if (plan.pulse !== undefined) {
    const name = plan.pulse;
    await browser.evaluate(`(() => { const box = document.querySelector('.settable[data-name=${JSON.stringify(name)}]'); box.open = true; })()`);
    await browser.until(`document.querySelector('.settable[data-name=${JSON.stringify(name)}] .pulse') !== null`);
    const before = [await value(name)].flat()[0];
    await browser.evaluate(`document.querySelector('.settable[data-name=${JSON.stringify(name)}] .pulse button').click()`);
    await until(async () => [await value(name)].flat()[0] === 10, `the pulse sets ${name}`);
    await browser.until("document.querySelector('.note').textContent.includes(' to ')");
    await browser.key('p');
    await until(async () => [await value(name)].flat()[0] === before, `${name} comes back after the pulse`);
  } else {
    await browser.key('p');
  }
  await until(async () => (await ask('run')).phase === 'running', 'the run goes on');

  // A wrong number is refused, and the reason is shown.
  if (plan.bounded !== undefined) {
    await browser.evaluate(`(() => { const box = document.querySelector('.settable[data-name=${JSON.stringify(plan.bounded)}]'); box.open = true; })()`);
    const field = `document.querySelector('.settable[data-name=${JSON.stringify(plan.bounded)}] input[type=number]')`;
    await browser.until(`${field} !== null`);
    await browser.evaluate(`(() => { const field = ${field}; field.value = '-1e9'; field.dispatchEvent(new Event('change')); })()`);
    await browser.until("document.querySelector('.note.wrong') !== null");
    const reason = await browser.evaluate("document.querySelector('.note').textContent");
    check(reason.includes('expected'), `the refusal has no reason: ${reason}`);
    const now = [await value(plan.bounded)].flat()[0];
    await browser.until(`Math.abs(Number(${field}.value) - ${now}) <= 1e-5 * ${Math.abs(now)}`);
    browser.errors = browser.errors.filter((text) => !text.includes('422'));
  }

  // Going back holds the picture; End leads to the newest time.
  await browser.evaluate('document.activeElement?.blur()');
  await browser.key('ArrowLeft');
  const held = await browser.evaluate('cotwin.time');
  await pause(300);
  check((await browser.evaluate('cotwin.time')) === held, 'the page goes on although somebody went back');
  await browser.key('End');
  await browser.until(`cotwin.time > ${held} && cotwin.player.following`);

  if (plan.latency) {
    const times = await browser.evaluate(`(async () => {
      const [drawn, taken] = [[], []];
      const name = ${JSON.stringify(plan.slider)};
      const { recording, live } = cotwin;
      await recording.load(name);
      const has = (wanted) => Math.abs(recording.values(name)[0][recording.rows - 1] - wanted) < 1e-5 * wanted;
      const take = recording.take.bind(recording);
      for (let k = 0; k < 40; ++k) {
        const wanted = ${set} * (1 + 0.001 * (k + 1));
        let came;
        recording.take = (sample) => { take(sample); if (came === undefined && has(wanted)) came = performance.now(); };
        const begin = performance.now();
        void live.connection.set(name, wanted);
        await new Promise((resolve) => {
          const look = () => { if (came !== undefined && cotwin.time >= recording.time[recording.rows - 1]) resolve(); else requestAnimationFrame(look); };
          requestAnimationFrame(look);
        });
        drawn.push(performance.now() - begin);
        taken.push(came - begin);
      }
      delete recording.take;
      return [taken, drawn].map((list) => list.sort((a, b) => a - b));
    })()`);
    times.forEach((list, i) => console.log(`from a change on the page to ${['its message', 'its drawn frame'][i]}: median ${list[20].toFixed(1)} ms, 95 %: ${list[37].toFixed(1)} ms`));
    console.log(`${(await browser.evaluate('cotwin.rate')).toFixed(1)} frames a second with new values`);
  }

  // A second click ends the run; the page keeps what it has.
  await browser.key('d');
  await shot('other_theme');
  check(await click('stop'), 'there is no button stop');
  check(await click('end the run?'), 'stop does not ask');
  await browser.until("cotwin.state.dataset.link === 'ended'");
  check(await browser.evaluate("[...document.querySelectorAll('.run button')].every((button) => button.disabled)"), 'the buttons are not switched off at the end');
  const last = await browser.evaluate('cotwin.player.end');
  check(last === (await browser.evaluate('cotwin.live.connection.state.time_s')), `the last moment of the run is not shown: ${last} s`);
  await browser.evaluate('cotwin.seek(cotwin.player.begin)');
  await browser.drawn();
  check((await browser.evaluate('cotwin.time')) < last, 'the recording is lost at the end');
  await shot('ended');

  check(browser.errors.length === 0, `the console says: ${browser.errors.join('; ')}`);
  const others = browser.requests.filter((asked) => !asked.startsWith(url) && !asked.startsWith('data:') && !asked.startsWith('blob:'));
  check(others.length === 0, `the page asks others: ${others.join(', ')}`);
  check(await browser.evaluate('globalThis.hacked === undefined'), 'a script from the data was run');
} catch (error) {
  check(false, error instanceof Error ? error.message : String(error));
} finally {
  await browser.close();
}
console.log(failures === 0 ? 'the live page is as expected' : `${failures} failures`);
process.exit(failures === 0 ? 0 : 1);
