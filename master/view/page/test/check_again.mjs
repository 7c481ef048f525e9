// check_again.mjs CHROMIUM COTWIN SCENARIO FOLDER: a page of a run whose process is killed keeps what it has, says so, and loads itself again when another
// run answers at its address; a process that stands still for a while is found again without that. Writes what failed, and ends with 1 then.
import { spawn } from 'node:child_process';
import { join } from 'node:path';
import { Browser } from './browser.mjs';

const [chromium, cotwin, scenario, folder] = process.argv.slice(2);
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
let failures = 0;
const check = (is_good, text) => {
  if (is_good) return;
  ++failures;
  console.log(`live page: ${text}`);
};

/// Starts a run and waits for its address.
function start(out, port) {
  const run = spawn(cotwin, ['run', scenario, `--view=${port}`, '--quiet', '--stop', '1000', '--out', join(folder, out)], { stdio: ['ignore', 'ignore', 'pipe'] });
  return new Promise((resolve, reject) => {
    let said = '';
    run.stderr.on('data', (data) => {
      said += data;
      const url = /live at (http:\/\/localhost:(\d+)\/)\n/.exec(said);
      if (url !== null) resolve({ run, url: url[1], port: url[2] });
    });
    run.on('exit', () => reject(new Error(`the run has ended: ${said}`)));
  });
}

const first = await start('first', 0);
let second;
const browser = await Browser.start(chromium);
try {
  await browser.open(first.url);
  await browser.until('cotwin.recording.rows > 10');
  await browser.evaluate('void (window.mark = 1)');
  const before = await browser.evaluate('cotwin.recording.rows');
  first.run.kill('SIGKILL');
  await browser.until("document.querySelector('.state').dataset.link === 'lost'");
  check((await browser.evaluate('cotwin.recording.rows')) >= before, 'what came before is lost');

  second = await start('second', first.port);
  await browser.until("window.mark === undefined && document.documentElement?.dataset.ready === 'true' && cotwin.recording.rows > 10");
  check((await browser.evaluate("document.querySelector('.state').textContent")) === 'live', 'the page of the new run is not live');

  await browser.evaluate('void (window.mark = 1)');
  const t = await browser.evaluate('cotwin.player.end');
  second.run.kill('SIGSTOP');
  await pause(500);
  second.run.kill('SIGCONT');
  await browser.until(`cotwin.player.end > ${t} + 0.5`);
  check((await browser.evaluate('window.mark')) === 1, 'the page was loaded again although the run was the same');
} catch (error) {
  check(false, error instanceof Error ? error.message : String(error));
} finally {
  await browser.close();
  first.run.kill('SIGKILL');
  second?.run.kill('SIGKILL');
}
process.exit(failures === 0 ? 0 : 1);
