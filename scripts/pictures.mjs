#!/usr/bin/env node
// pictures.mjs [NAME…]: runs examples and writes the pictures of the README, docs/pictures/NAME.webp. Needs ./run.sh before, and Chromium.
import { spawn, spawnSync } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { Browser } from '../master/view/page/test/browser.mjs';

const root = dirname(dirname(fileURLToPath(import.meta.url)));
const cotwin = join(root, 'build/release/bin/cotwin');
const folder = mkdtempSync(join(tmpdir(), 'cotwin_pictures_'));
const kReady = "document.readyState === 'complete'"; // of pages without a script

// cues: keys; t: time that is shown, s; report: heading of the report that is shown; file: in the results, in place of a page; only3d: without the panels, since the picture is small; from, to: the camera, and what it looks at
const pictures = [
  { name: 'view', scenario: '02_free_motion_lwr4/twin.ssd', cues: 'tm', t: 10, size: [1180, 700] },
  { name: 'peg', scenario: '04_peg_in_hole/twin.ssd', cues: 'gt', t: 24.5, only3d: true },
  { name: 'compliance', scenario: '07_cartesian_compliance/twin.ssd', cues: 'gs', t: 14.5, only3d: true },
  { name: 'carrying', scenario: '10_cooperation/carrying.ssd', cues: 'ct', t: 9, only3d: true },
  { name: 'hulls', scenario: '20_safety_hulls/cell.ssd', cues: 'x', t: 2.6, only3d: true, from: [2.7, 2.5, 2], to: [0.8, 0.05, 0.66] },
  { name: 'shared_cell', scenario: '25_shared_cell/cell.ssd', cues: 'x', t: 6.5, only3d: true, from: [5, 1.6, 2.6], to: [1.3, -0.5, 0.4] },
  { name: 'reaction', scenario: '21_reaction/reaction.ssd', cues: '', t: 6.7, only3d: true },
  { name: 'reactionless', script: '22_reactionless/run.sh', results: ['run'], cues: 't', t: 5, only3d: true },
  { name: 'latch', scenario: '23_latch/latch.ssd', cues: 'tc', t: 4.5, only3d: true },
  { name: 'servicing', script: '24_satellite_servicing/run.sh', results: ['run'], cues: 'g', t: 4.15, only3d: true },
  { name: 'insertion', script: '24_satellite_servicing/run.sh', results: ['run'], cues: 'g', t: 13.8, only3d: true, from: [1.4, -1.2, 1.5], to: [0.5, -0.1, 0.75] },
  { name: 'corrected', script: '24_satellite_servicing/run.sh', results: ['corrected'], cues: 't', t: 4.15, only3d: true },
  { name: 'refused', scenario: '12_mes/refused.ssd', cues: 'xt', t: 1.065, only3d: true },
  { name: 'scanned_cell', scenario: '29_scanned_cell/cell.ssd', cues: 'x', t: 2.2, only3d: true, from: [-2.2, -2.4, 2.6], to: [0.5, 0.1, 0.8] },
  { name: 'scan_profile', scenario: '30_scan_the_cell/profile.ssd', cues: 'b', t: 4.4, only3d: true, from: [-0.9, -1.9, 2.1], to: [0.45, 0.15, 0.85] },
  { name: 'scan_the_cell', script: '30_scan_the_cell/run.sh', results: ['run'], cues: 'x', t: 2.2, only3d: true, from: [-1.1, -1.7, 2.1], to: [0.5, 0.1, 0.8] },
  { name: 'map', script: '28_map/run.sh', file: 'map.svg', size: [760, 340] },
  { name: 'mes', script: '12_mes/run.sh', results: ['quintic', 'cheaper'], report: 'against' },
  { name: 'report', scenario: '02_free_motion_lwr4/twin.ssd', report: 'Residuals' },
  { name: 'live', scenario: '10_cooperation/guidance.ssd', live: true, cues: 'gch', t: 6, size: [1180, 760] },
];

function run(command, args, options = {}) {
  const done = spawnSync(command, args, { cwd: folder, encoding: 'utf8', ...options });
  if (done.status !== 0) throw new Error(`${command} ${args.join(' ')}: ${done.stderr}`);
}

/// Starts a run with its page. Returns the process and the address.
async function start(picture) {
  const process = spawn(cotwin, ['run', join(root, 'examples', picture.scenario), '--view=0', '--out', picture.name], { cwd: folder });
  let said = '';
  const url = await new Promise((resolve, reject) => {
    process.on('exit', () => reject(new Error(said)));
    for (const stream of [process.stdout, process.stderr]) {
      stream.on('data', (data) => {
        said += data;
        const found = /live at (http:\S+)/.exec(said);
        if (found) resolve(found[1]);
      });
    }
  });
  return { process, url };
}

async function take(picture) {
  const [width, height] = picture.size ?? (picture.report ? [860, 720] : [1200, 560]);
  const browser = await Browser.start(process.env.CHROMIUM ?? 'chromium', { width, height });
  let live;
  try {
    let results = [picture.name];
    if (picture.live) live = await start(picture);
    else if (picture.script) {
      run(join(root, 'examples', picture.script), [], { env: { ...process.env, COTWIN: cotwin, OUT: folder } });
      ({ results } = picture);
    } else run(cotwin, ['run', join(root, 'examples', picture.scenario), '--out', picture.name, '--quiet']);
    const page = join(folder, picture.file ?? `${picture.name}.html`);
    if (!picture.live && !picture.file) run(cotwin, [picture.report ? 'report' : 'view', ...results, ...(picture.report ? [] : ['--no-open']), '-o', page]);
    await browser.open(live?.url ?? pathToFileURL(page).href, picture.report || picture.file ? kReady : undefined);
    for (const key of picture.cues ?? '') await browser.key(key);
    if (picture.live) await browser.until(`cotwin.time >= ${picture.t}`);
    else if (picture.t !== undefined) await browser.evaluate(`cotwin.seek(${picture.t})`);
    if (picture.from) await browser.evaluate(`cotwin.stage.controls.target.set(${picture.to}) && cotwin.stage.camera.position.set(${picture.from}) && cotwin.stage.controls.update()`);
    if (picture.report) await browser.evaluate(`[...document.querySelectorAll('h3')].find((heading) => heading.textContent.includes('${picture.report}')).scrollIntoView()`);
    const clip = picture.only3d ? await browser.evaluate("(() => { const { x, y, width, height } = document.querySelector('canvas').getBoundingClientRect(); return { x, y, width, height, scale: 1 }; })()") : undefined;
    await browser.drawn();
    writeFileSync(join(root, 'docs/pictures', `${picture.name}.webp`), await browser.screenshot('webp', clip));
  } finally {
    await browser.close();
    live?.process.removeAllListeners('exit');
    live?.process.kill('SIGKILL');
  }
}

try {
  const names = process.argv.slice(2);
  for (const picture of pictures) if (names.length === 0 || names.includes(picture.name)) await take(picture);
} finally {
  rmSync(folder, { recursive: true, force: true });
}
