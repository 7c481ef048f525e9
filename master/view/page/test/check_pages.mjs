// check_pages.mjs CHROMIUM PLAN.json [FOLDER]: opens pages in Chromium and compares them with what a plan expects. Writes one line per failure and
// ends with 1 if there is one. FOLDER: for screenshots. The plan is a list of
//   { file, size?, dark?, title?, figures?, seeks?: [{ t, figures?: [{ bodies, tip }], bodies?: { name: matrix }, tools?: { name on robot 0: matrix, or null for hidden }, plots?: { name: values }, texts?: { name: legend }, lights?: { name: zone } }],
//     profile?: [coordinates of all points of profiles, with the last one of seeks], cues?: [ids that have data], lacking?: [ids], remarks?: [texts], words?: [texts, with these cues on], colours?: least number in the 3D view, keys?: true, themes?: true, zoom?: name of a plot, frames?,
//     first?: number of robots that are large at first sight, on a screen and on a phone, near?: [name of a body, t] that is in view then, legend?: entries of the first legend, arrows?: key of a cue, hash?: true }
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';
import { Browser } from './browser.mjs';

const [chromium, plan_file, folder] = process.argv.slice(2);
const plan = JSON.parse(readFileSync(plan_file, 'utf8'));
let failures = 0;
let place = '';

function check(is_good, text) {
  if (is_good) return;
  ++failures;
  console.log(`${place}: ${text}`);
}

/// float32 keeps 24 bits of a joint's position; a pose adds up some of them.
function near(found, wanted, what, tolerance = 2e-6) {
  const worst = found && wanted && found.length === wanted.length ? Math.max(...wanted.map((x, i) => Math.abs(x - found[i]))) : NaN;
  check(worst <= tolerance, `${what} differs by ${worst}: ${JSON.stringify(found)}, expected ${JSON.stringify(wanted)}`);
}

/// Colours that the 3D view shows, by their number of pixels, after it was drawn now.
const kColours = `(() => {
  const { stage } = cotwin;
  stage.invalidate();
  stage.draw(0);
  const gl = stage.renderer.getContext();
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const pixels = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const counts = {};
  for (let i = 0; i < pixels.length; i += 4) {
    const colour = (pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2];
    counts[colour] = (counts[colour] ?? 0) + 1;
  }
  return { pixels: width * height, colours: Object.keys(counts).length, background: Math.max(...Object.values(counts)) };
})()`;

async function look(browser, step) {
  await browser.evaluate(`cotwin.seek(${step.t})`);
  await browser.drawn();
  for (const [i, figure] of (step.figures ?? []).entries()) {
    const found = await browser.evaluate(`cotwin.poses(${i})`);
    figure.bodies.forEach((pose, k) => near(found.bodies[k], pose, `t = ${step.t}: body ${k} of figure ${i}`));
    near(found.tip, figure.tip, `t = ${step.t}: tip of figure ${i}`);
  }
  for (const [name, pose] of Object.entries(step.bodies ?? {})) near(await browser.evaluate(`cotwin.body_pose(${JSON.stringify(name)})`), pose, `t = ${step.t}: body ${name}`);
  const lights = await browser.evaluate("Object.fromEntries([...document.querySelectorAll('.light')].map((box) => [box.children[1].textContent, box.dataset.zone]))");
  for (const [name, zone] of Object.entries(step.lights ?? {})) check(lights[name] === zone, `t = ${step.t}: light ${name} is ${lights[name]}, expected ${zone}`);
  for (const [name, pose] of Object.entries(step.tools ?? {})) {
    const found = await browser.evaluate(`cotwin.tool_pose(0, ${JSON.stringify(name)})`);
    if (pose === null) check(found === null, `t = ${step.t}: tool ${name} is shown`);
    else near(found, pose, `t = ${step.t}: tool ${name}`);
  }
  const shown = await browser.evaluate('cotwin.plot_values()');
  for (const [name, texts] of Object.entries(step.texts ?? {})) check(JSON.stringify(shown[name]) === JSON.stringify(texts), `t = ${step.t}: the plot of ${name} shows ${shown[name]}, expected ${texts}`);
  for (const [name, values] of Object.entries(step.plots ?? {})) {
    values.forEach((value, i) => {
      const text = shown[name]?.[i];
      const number = text === '∞' ? Infinity : text === '-∞' ? -Infinity : Number(text);
      const is_same = value === null ? text === 'NaN' : Math.abs(number - value) <= 6e-4 * Math.abs(value) + 1e-7 * (step.range ?? 1);
      check(is_same, `t = ${step.t}: the plot of ${name} shows ${text} for element ${i + 1}, recorded is ${value}`);
    });
  }
}

async function press_keys(browser) {
  const state = () => browser.evaluate('({ t: cotwin.time, begin: cotwin.player.begin, end: cotwin.player.end, playing: cotwin.player.playing, speed: cotwin.player.speed })');
  await browser.key('End');
  let now = await state();
  check(now.t === now.end, `End leads to ${now.t}, expected ${now.end}`);
  await browser.key('ArrowLeft');
  const before = await browser.evaluate('cotwin.recording.time[cotwin.recording.rows - 2]');
  check((await state()).t === before, `the left arrow leads to ${(await state()).t}, expected the row before the last, ${before}`);
  await browser.key('Home');
  await browser.key('ArrowRight');
  const second = await browser.evaluate('cotwin.recording.time[1]');
  check((await state()).t === second, `the right arrow leads to ${(await state()).t}, expected the second row, ${second}`);
  await browser.key('+');
  check((await state()).speed === 2, `+ leads to the speed ${(await state()).speed}, expected 2`);
  await browser.key('-');
  await browser.key(' ');
  await browser.until(`cotwin.time > ${second}`);
  await browser.key(' ');
  now = await state();
  await browser.drawn();
  check(!now.playing && (await state()).t === now.t, 'the space bar does not stop the time');
  await browser.key('?');
  check(await browser.evaluate("document.querySelector('dialog').open"), '? does not show the help');
  await browser.key('Escape');
  await browser.evaluate("document.querySelector('dialog').close()");
}

async function switch_cues(browser, page) {
  const entries = await browser.evaluate("Object.fromEntries([...document.querySelectorAll('.cue')].map((cue) => [cue.dataset.cue, { off: cue.querySelector('input').disabled, key: cue.querySelector('kbd').textContent, text: cue.textContent, title: cue.title }]))");
  for (const id of page.lacking ?? []) {
    check(entries[id]?.off === true && /^no data: \S/.test(entries[id].title), `cue ${id} should say what must be recorded, it is: ${JSON.stringify(entries[id])}`);
  }
  for (const id of page.cues ?? []) {
    check(entries[id]?.off === false, `cue ${id} has no data: ${entries[id]?.text}`);
    if (entries[id]?.off !== false) continue;
    await browser.key(entries[id].key);
    await browser.until(`cotwin.shown.has('${id}')`);
    await browser.drawn();
    const text = await browser.evaluate(`document.querySelector('[data-cue="${id}"]').textContent`);
    check(text.length > entries[id].text.length && !/NaN|undefined/.test(text), `cue ${id} shows no figures: ${text}`);
  }
}

/// The box of the first cloud in the world, and how many of its pixels are in the colour of distances while a place is marked, and when none is.
async function look_at_cloud(browser, { box, near: place }) {
  const found = await browser.evaluate('(() => { const { min, max } = cotwin.clouds[0].box(); return [...min.toArray(), ...max.toArray()]; })()');
  check(found.every((x, i) => Math.abs(x - box[i]) < 2e-4), `the cloud is in the box ${found}, expected ${box}`);
  const marked = await browser.evaluate('cotwin.marks.uniforms.marks.value[0].toArray()');
  check(Math.hypot(...marked.map((x, i) => x - place[i])) < 1e-3, `points are marked at ${marked}, expected ${place}`);
  const blue = () => browser.evaluate(`(() => { const { stage } = cotwin; stage.invalidate(); stage.draw(0); const gl = stage.renderer.getContext(); const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight]; const p = new Uint8Array(4 * w * h); gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p); let n = 0; for (let i = 0; i < p.length; i += 4) n += Math.hypot(p[i], p[i + 1] - 0x72, p[i + 2] - 0xb2) < 12; return n; })()`);
  const with_mark = await blue();
  await browser.evaluate('cotwin.marks.set([])');
  const without = await blue();
  check(with_mark > without + 100, `${with_mark} pixels are in the colour of distances, ${without} without a mark`);
}

async function change_themes(browser) {
  const brightness = () => browser.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3).reduce((sum, x) => sum + Number(x), 0)");
  const is_light = (await brightness()) > 384;
  await browser.key('d');
  check((await brightness()) > 384 !== is_light, 'd does not change dark and light');
  await browser.key('d');
  // The lines' colours: every pair differs for people who do not see red or green (Viénot, Brettel, Mollon 1999), and each from the background.
  const colours = await browser.evaluate("cotwin.plots.flatMap((plot) => [...plot.box.querySelectorAll('.key')].map((key) => getComputedStyle(key).borderTopColor)).slice(0, 7)");
  const linear = colours.map((text) => text.match(/\d+/g).slice(0, 3).map((x) => (Number(x) / 255) ** 2.2));
  const seen = { normal: ([r, g, b]) => [r, g, b], protan: ([r, g, b]) => [0.11238 * r + 0.88762 * g, 0.11238 * r + 0.88762 * g, 0.00401 * r - 0.00401 * g + b], deutan: ([r, g, b]) => [0.29275 * r + 0.70725 * g, 0.29275 * r + 0.70725 * g, -0.02234 * r + 0.02234 * g + b] };
  for (const [who, of] of Object.entries(seen)) {
    linear.forEach((a, i) => linear.slice(0, i).forEach((b, k) => {
      const distance = Math.hypot(...of(a).map((x, c) => Math.max(0, x) ** (1 / 2.2) - Math.max(0, of(b)[c]) ** (1 / 2.2)));
      check(distance > 0.09, `${who}: lines ${i + 1} (${colours[i]}) and ${k + 1} (${colours[k]}) are too similar: ${distance}`);
    }));
  }
}

async function use_mouse(browser, name) {
  const box = await browser.evaluate(`(() => { const plot = cotwin.plots.find((p) => p.name === ${JSON.stringify(name)}); plot.box.scrollIntoView(); const { left, top, width, height } = plot.chart.over.getBoundingClientRect(); return { left, top, width, height }; })()`);
  const y = box.top + box.height / 2;
  const range = () => browser.evaluate('[cotwin.range.from, cotwin.range.to]');
  const [from, to] = await range();
  await browser.mouse('mousePressed', box.left + box.width / 4, y);
  await browser.mouse('mouseMoved', box.left + box.width / 2, y);
  await browser.mouse('mouseReleased', box.left + box.width / 2, y);
  const t = await browser.evaluate('cotwin.time');
  check(Math.abs(t - (from + to) / 2) <= ((to - from) * 3) / box.width, `dragging to the middle of ${name} leads to ${t}, expected ${(from + to) / 2}`);
  await browser.mouse('mouseWheel', box.left + box.width / 2, y, { delta: -400 });
  await browser.until(`cotwin.range.to - cotwin.range.from < ${0.9 * (to - from)}`);
  const drawn = await browser.evaluate(`(() => { const plot = cotwin.plots.find((p) => p.name === ${JSON.stringify(name)}); return { points: plot.chart.data[0].length, first: plot.chart.scales.x.min }; })()`);
  check(drawn.points >= 2 && Math.abs(drawn.first - (await range())[0]) < 1e-9, `the plot of ${name} does not show the closer range: ${JSON.stringify(drawn)}`);
  await browser.key('0');
  check(JSON.stringify(await range()) === JSON.stringify([from, to]), '0 does not show the whole recording');
}

/// Functions of the page for what is seen of it.
const kSight = `(() => {
  const { camera, scene } = cotwin.stage;
  camera.updateMatrixWorld();
  scene.updateMatrixWorld(true);
  /// Least and largest coordinates on the screen, from -1 to 1, of an object's points.
  const seen = (object) => {
    const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
    object.traverseVisible((part) => {
      const points = part.geometry?.attributes.position;
      for (let i = 0; i < (points?.count ?? 0); ++i) {
        const [x, y] = camera.position.clone().fromBufferAttribute(points, i).applyMatrix4(part.matrixWorld).project(camera).toArray();
        [low[0], low[1], high[0], high[1]] = [Math.min(low[0], x), Math.min(low[1], y), Math.max(high[0], x), Math.max(high[1], y)];
      }
    });
    return { low, high, height: (high[1] - low[1]) / 2 };
  };
  /// The texts that an axis cuts off, when all plots draw again.
  const cut = () => {
    const texts = [];
    const write = CanvasRenderingContext2D.prototype.fillText;
    CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
      const { a, d, e, f } = this.getTransform();
      const { actualBoundingBoxLeft: left, actualBoundingBoxRight: right, actualBoundingBoxAscent: up, actualBoundingBoxDescent: down } = this.measureText(text);
      const box = [a * (x - left) + e, a * (x + right) + e, d * (y - up) + f, d * (y + down) + f];
      texts.push({ text, inside: box[0] >= -0.5 && box[1] <= this.canvas.width + 0.5 && box[2] >= -0.5 && box[3] <= this.canvas.height + 0.5 });
      return write.call(this, text, x, y);
    };
    for (const plot of cotwin.plots) plot.build();
    return new Promise((resolve) => setTimeout(() => { CanvasRenderingContext2D.prototype.fillText = write; resolve({ count: texts.length, cut: texts.filter(({ inside }) => !inside).map(({ text }) => text) }); }, 50));
  };
  return { seen, cut };
})()`;

/// All `count` robots are in the view, and large there.
async function see_robots(browser, count, where) {
  const robots = await browser.evaluate(`(() => { const { seen } = ${kSight}; return cotwin.figures.map((view) => seen(view.main.group)); })()`);
  check(robots.length === count, `${robots.length} robots are shown, expected ${count}`);
  for (const [i, { low, high, height }] of robots.entries())
    check(height >= 0.2 && Math.max(...high) <= 1 && Math.min(...low) >= -1, `${where} robot ${i + 1} has ${(100 * height).toFixed(1)} % of the view's height, from ${low} to ${high}, expected 20 % and all of it`);
}

/// Robots stay large when the window gets another size, as long as nobody has moved the camera.
async function turn_window(browser, count) {
  const first = await browser.evaluate('cotwin.stage.view');
  await browser.look(390, 844, false);
  await browser.until('cotwin.stage.width <= 390');
  await see_robots(browser, count, 'in a window that is a phone now');
  await browser.look(1400, 900, false);
  await browser.until('cotwin.stage.width > 390');
  near(await browser.evaluate('cotwin.stage.view'), first, 'camera of a window that is a screen again', 1e-9);
  await browser.evaluate('cotwin.stage.chosen = true');
  await browser.look(390, 844, false);
  await browser.until('cotwin.stage.width <= 390');
  near(await browser.evaluate('cotwin.stage.view'), first, 'camera that was chosen, in another window', 1e-9);
  await browser.look(1400, 900, false);
  await browser.until('cotwin.stage.width > 390');
}

/// What a page must be like when it is opened, at the present size of the window.
async function look_at_first(browser, page, is_phone) {
  const where = is_phone ? 'on a phone' : 'on a screen';
  await see_robots(browser, page.first, where);
  if (page.near) {
    const [name, t] = page.near;
    const at = await browser.evaluate(`(() => { cotwin.seek(${t}); cotwin.show(); const { seen } = ${kSight}; const found = seen(cotwin.bodies.find((view) => view.body.name === '${name}').group); cotwin.seek(cotwin.player.begin); return found; })()`);
    check(Math.max(...at.high) <= 1 && Math.min(...at.low) >= -1, `${where} body ${name} is from ${at.low} to ${at.high} at ${t} s, expected within the view`);
  }
  const ground = await browser.evaluate(`(() => { const all = new cotwin.ground.constructor(); for (const point of cotwin.surroundings.whole()) all.expandByPoint(point); const grid = new cotwin.ground.constructor().setFromObject(cotwin.stage.ground); return { low: all.min.z - grid.max.z, beside: Math.min(all.min.x - grid.min.x, all.min.y - grid.min.y, grid.max.x - all.max.x, grid.max.y - all.max.y) }; })()`);
  // On a plane of the scene its lines are 1 mm higher.
  check(ground.low >= -0.0011 && ground.beside >= 0, `the ground is ${ground.low} m below and ${ground.beside} m beside what is on it`);
  const labels = await browser.evaluate(`(() => { const { cut } = ${kSight}; return cut(); })()`);
  check(labels.count > 3 * (page.plots ?? 1) && labels.cut.length === 0, `${where} ${labels.cut.length} of ${labels.count} labels are cut: ${labels.cut.join(' ')}`);
  const legends = await browser.evaluate("cotwin.plots.map((plot) => [...plot.box.querySelectorAll('.entry:not(.more)')].filter((entry) => !entry.hidden).length)");
  check(Math.max(0, ...legends) <= 8 && (page.legend === undefined || legends[0] === page.legend), `legends have ${legends} entries`);
  const heights = await browser.evaluate("cotwin.plots.map((plot) => plot.box.querySelector('.chart').offsetHeight)");
  check(new Set(heights).size <= 1, `plots have the heights ${heights}`);
  const wide = await browser.evaluate("[...document.querySelectorAll('#app, #app > *, .top > *, .line > *')].filter((box) => box.getBoundingClientRect().right > innerWidth + 0.5 || box.getBoundingClientRect().bottom > innerHeight + 0.5).map((box) => box.className || box.tagName)");
  const scroll = await browser.evaluate('[document.documentElement.scrollWidth - innerWidth, document.documentElement.scrollHeight - innerHeight]');
  check(wide.length === 0 && Math.max(...scroll) <= 0, `${where} the page scrolls by ${scroll} pixels; beyond the window are: ${wide.join(', ')}`);
  if (is_phone) {
    await browser.evaluate("document.querySelector('#cues').open = true");
    const small = await browser.evaluate("[...document.querySelectorAll('button, select, summary, label, input')].map((part) => [part, part.getBoundingClientRect()]).filter(([, box]) => box.width > 0 && Math.min(box.width, box.height) < 23.99).map(([part, box]) => `${part.textContent || part.type} ${box.width} x ${box.height}`)");
    check(small.length === 0, `targets smaller than 24 pixels: ${small.join(', ')}`);
  }
  if (page.arrows !== undefined) {
    await browser.key(page.arrows);
    await browser.drawn();
    const arrows = await browser.evaluate(`(() => { const { seen } = ${kSight}; const found = []; cotwin.stage.scene.traverseVisible((part) => { if (part.children.length === 2 && part.children[1].geometry?.type === 'ConeGeometry') found.push(seen(part).height); }); return found; })()`);
    check(found_arrows(arrows), `${where} arrows have ${arrows} of the view's height, expected a third at most`);
    await browser.key(page.arrows);
  }
  await browser.key('?');
  const help = await browser.evaluate("(() => { const dialog = document.querySelector('dialog'); const box = dialog.getBoundingClientRect(); return { top: dialog.querySelector('h2').getBoundingClientRect().top - box.top, scroll: dialog.scrollTop, left: box.left, right: innerWidth - box.right, broken: [...dialog.querySelectorAll('td:first-child')].filter((cell) => { const range = document.createRange(); range.selectNodeContents(cell); return new Set([...range.getClientRects()].map((line) => line.top)).size > 1; }).map((cell) => cell.textContent) }; })()");
  check(help.scroll === 0 && help.top >= 0 && help.top < 60 && Math.min(help.left, help.right) >= 0 && help.broken.length === 0, `${where} the help opens as ${JSON.stringify(help)}`);
  await browser.evaluate("document.querySelector('dialog').close()");
}
/// There are some, and a third of the view is the longest; their heads are seen from any side.
const found_arrows = (heights) => heights.length > 0 && Math.max(...heights) > 0.05 && Math.max(...heights) <= 0.36;

/// Space plays after a click on a cue, and presses what Tab has reached.
async function click_and_play(browser) {
  const { x, y } = await browser.evaluate("(() => { const { left, top, height } = document.querySelector('.cue label:not(.lacking)').getBoundingClientRect(); return { x: left + 5, y: top + height / 2 }; })()");
  await browser.mouse('mousePressed', x, y);
  await browser.mouse('mouseReleased', x, y);
  await browser.until('cotwin.shown.size === 1');
  await browser.key(' ');
  check(await browser.evaluate('cotwin.player.playing && cotwin.shown.size === 1'), 'Space does not play after a click on a cue');
  await browser.key(' ');
  await browser.key('Tab');
  await browser.evaluate("document.querySelector('.cue input:checked').focus()");
  await browser.key(' ');
  check(await browser.evaluate('!cotwin.player.playing && cotwin.shown.size === 0'), 'Space does not press a check box that Tab has reached');
}

/// A link opens the same view; a bad one opens the page as it is at first.
async function follow_links(browser, url) {
  const state = "JSON.stringify({ t: +cotwin.time.toFixed(6), cues: [...cotwin.shown].sort(), plots: cotwin.plots.map((plot) => plot.key), range: [cotwin.range.from, cotwin.range.to].map((t) => +t.toFixed(6)), camera: cotwin.stage.view.map((x) => +x.toFixed(6)) })";
  await browser.open(url);
  const first = await browser.evaluate(state);
  await browser.evaluate("cotwin.plots[0].box.querySelector('header button').click()");
  const cue = await browser.evaluate("document.querySelector('.cue label:not(.lacking) kbd').textContent");
  const { x, y } = await browser.evaluate("(() => { const { left, top, width, height } = document.querySelector('canvas').getBoundingClientRect(); return { x: left + width / 2, y: top + height / 2 }; })()");
  await browser.mouse('mousePressed', x, y);
  await browser.mouse('mouseMoved', x + 90, y + 30);
  await browser.mouse('mouseReleased', x + 90, y + 30);
  await browser.key(cue);
  await browser.evaluate('cotwin.seek(cotwin.player.begin + 0.37 * (cotwin.player.end - cotwin.player.begin))');
  await browser.key('[');
  await browser.until("cotwin.shown.size === 1 && location.hash.includes('range=')");
  const [here, link] = [await browser.evaluate(state), await browser.evaluate('location.href')];
  check(here !== first && /camera=/.test(link), `the view did not change: ${link}`);
  await browser.open(link);
  const there = await browser.evaluate(state);
  check(there === here, `${link} opens ${there}, expected ${here}`);
  for (const bad of ['#t=x&camera=1,2&cues=none&plot=none&range=2,1', '#%', '#t=&camera=NaN,0,0,0,0,0', '#<script>hacked=1</script>']) {
      await browser.open(url + bad);
    const opened = await browser.evaluate(state);
    check(opened === first, `${bad} opens ${opened}, expected ${first}`);
  }
}

const browser = await Browser.start(chromium);
for (const [index, page] of plan.entries()) {
  place = page.file.split('/').slice(-2).join('/');
  try {
    if (page.hash) {
      await follow_links(browser, pathToFileURL(page.file).href);
      await click_and_play(browser);
    }
    for (const is_phone of page.first === undefined ? [] : [true, false]) {
      await browser.look(...(is_phone ? [390, 844, true] : [1400, 900, false]));
      await browser.open(pathToFileURL(page.file).href);
      await look_at_first(browser, page, is_phone);
    }
    if (page.first !== undefined) await turn_window(browser, page.first);
    let ms = 0;
    if (page.first === undefined) {
      await browser.look(...(page.size ?? [1280, 800]), page.dark === true);
      ms = await browser.open(pathToFileURL(page.file).href);
    }
    if (page.figures_of_speed) console.log(`${place}: ready after ${ms} ms`);
    check(await browser.evaluate("document.querySelector('.failure') === null"), `the page says: ${await browser.evaluate("document.querySelector('.failure')?.textContent ?? ''")}`);
    if (page.title !== undefined) {
      const heading = await browser.evaluate("document.querySelector('h1').textContent");
      check(heading === page.title, `the heading is ${heading}, expected ${page.title}`);
    }
    for (const step of page.seeks ?? []) await look(browser, step);
    const remarks = await browser.evaluate("document.querySelector('.remarks').textContent");
    for (const text of page.remarks ?? []) check(remarks.includes(text), `the remarks do not say '${text}': ${remarks}`);
    const view = await browser.evaluate(kColours);
    check(view.colours >= (page.colours ?? 20) && view.background < 0.995 * view.pixels, `the 3D view is empty: ${JSON.stringify(view)}`);
    if (page.cues !== undefined || page.lacking !== undefined) await switch_cues(browser, page);
    if (page.cloud !== undefined) await look_at_cloud(browser, page.cloud);
    if (page.profile !== undefined) {
      const points = await browser.evaluate("[...cotwin.stage.scene.getObjectByName('profiles').geometry.attributes.position.array]");
      check(points.length === page.profile.length && points.every((x, i) => Math.abs(x - page.profile[i]) < 1e-5), `the profile has ${points.length / 3} points, the first one at ${points.slice(0, 3)}, expected ${page.profile.length / 3}, at ${page.profile.slice(0, 3)}`);
    }
    const words = await browser.evaluate('document.body.textContent');
    for (const text of page.words ?? []) check(words.includes(text), `the page does not say '${text}'`);
    if (page.keys) await press_keys(browser);
    if (page.themes) await change_themes(browser);
    if (page.zoom !== undefined) await use_mouse(browser, page.zoom);
    if (page.figures_of_speed) {
      await browser.key('Home');
      await browser.key(' ');
      await new Promise((resolve) => setTimeout(resolve, 4000));
      console.log(`${place}: ${(await browser.evaluate('cotwin.rate')).toFixed(1)} frames a second at ${await browser.evaluate('cotwin.stage.scale')} of the resolution`);
    }
    check(browser.errors.length === 0, `the console says: ${browser.errors.join('; ')}`);
    const others = browser.requests.filter((url) => !url.startsWith('file:') && !url.startsWith('data:') && !url.startsWith('blob:'));
    check(others.length === 0 && browser.requests.filter((url) => url.startsWith('file:')).length === 1, `the page asks for ${browser.requests.join(', ')}`);
    check(await browser.evaluate('globalThis.hacked === undefined'), 'a script from the data was run');
    if (folder) writeFileSync(join(folder, `page_${index + 1}.png`), await browser.screenshot());
  } catch (error) {
    check(false, error instanceof Error ? error.message : String(error));
  }
}
await browser.close();
console.log(failures === 0 ? `${plan.length} pages are as expected` : `${failures} failures`);
process.exit(failures === 0 ? 0 : 1);
