// check_gateway.mjs CHROMIUM URL: opens the page of a gateway without a run in Chromium, and compares it with what the gateway answers beside it. Writes one
// line per failure and ends with 1 if there is one.
import { Browser } from './browser.mjs';

const [chromium, url] = process.argv.slice(2);
let failures = 0;

function check(is_good, text) {
  if (is_good) return;
  ++failures;
  console.log(`gateway page: ${text}`);
}

const ask = async (path, options) => (await fetch(new URL(path, url), options)).json();
const browser = await Browser.start(chromium, { width: 1200, height: 900 });
try {
  await browser.open(url);
  const texts = (selector) => browser.evaluate(`[...document.querySelectorAll(${JSON.stringify(selector)})].map((found) => found.textContent)`);
  check((await texts('.failure')).length === 0 && (await texts('h1'))[0] === 'Cotwin gateway', `it shows ${await texts('body')}`);
  const { robots, default: first, data } = await ask('robots');
  const told = (name) => ['drive_train.ssv', 'compliance.ssv', 'energy.ssv'].map((file) => `${file} ${data[name][file]}`).join(', ');
  const expected = robots.map((name) => `${name}${name === first ? ' default;' : ''} ${told(name)}`);
  check(JSON.stringify(await texts('summary')) === JSON.stringify(expected), `robots ${await texts('summary')}`);
  check(data.lwr4['drive_train.ssv'] === 'assumed' && data.scara['energy.ssv'] === 'missing', `data ${JSON.stringify(data)}`);
  for (const [i, name] of robots.entries()) {
    const { joints } = await ask(`robots/${name}`);
    await browser.evaluate(`document.querySelectorAll('details')[${i}].open = true`);
    const rows = `document.querySelectorAll('details')[${i}].querySelectorAll('td:first-child')`;
    await browser.until(`${rows}.length > 0`);
    const shown = await browser.evaluate(`[...${rows}].map((cell) => cell.textContent)`);
    check(JSON.stringify(shown) === JSON.stringify(joints.map((joint) => joint.name)), `joints of ${name}: ${shown}`);
    const cells = await browser.evaluate(`document.querySelectorAll('details')[${i}].textContent`);
    check(joints.every(({ type }) => cells.includes(type === 'prismatic' ? ' m/s' : ' rad/s')) && !/NaN|undefined|none to none/.test(cells), `limits of ${name}: ${cells}`);
  }
  const { WorkMasters } = await ask('work-masters');
  const shown = await texts('section:nth-of-type(2) td:first-child');
  check(JSON.stringify(shown) === JSON.stringify(WorkMasters.map(({ ID }) => ID)), `services ${shown}`);
  check((await texts('#jobs'))[0] === 'no job yet', `jobs before the first: ${await texts('#jobs')}`);
  const request = { robot: 'lwr4', from_q_rad: [0, -0.9, 0, 1.2, 0, 0.6, 0], to_q_rad: [1.2, 0.9, 0, -1.2, 0, -0.6, 0] };
  const { JobOrder } = await ask('services/feasibility', { method: 'POST', headers: { 'Content-Type': 'application/json', Prefer: 'respond-async' }, body: JSON.stringify(request) });
  await browser.until("document.querySelector('#jobs').textContent.includes('Ended')");
  const jobs = (await texts('#jobs'))[0];
  check(jobs.includes(JobOrder.JobOrderID) && jobs.includes('Successful') && jobs.includes('feasibility'), `jobs: ${jobs}`);
  check(browser.errors.length === 0, `the console says: ${browser.errors.join('; ')}`);
  check(browser.requests.every((asked) => asked.startsWith(url) || asked.startsWith('data:')), `the page asks for ${browser.requests.join(', ')}`);
} catch (error) {
  check(false, error instanceof Error ? error.message : String(error));
} finally {
  await browser.close();
}
process.exit(failures === 0 ? 0 : 1);
