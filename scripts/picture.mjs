// picture.mjs PAGE PICTURE.webp SECONDS [CUE…]: a picture of a page of `cotwin view` at a time, with cues switched on. Needs node and Chromium.
// docs/pictures/view.webp: `node scripts/picture.mjs results/free_motion_lwr4/view.html docs/pictures/view.webp 1.4 trails mass`
import { writeFileSync } from 'node:fs';
import { pathToFileURL } from 'node:url';
import { Browser } from '../master/view/page/test/browser.mjs';

const [page, picture, seconds, ...cues] = process.argv.slice(2);
if (seconds === undefined || !picture.endsWith('.webp')) {
  console.error('usage: picture.mjs PAGE PICTURE.webp SECONDS [CUE…]');
  process.exit(2);
}
const browser = await Browser.start(process.env.CHROMIUM ?? 'chromium', { width: 1200, height: 675 });
try {
  await browser.open(pathToFileURL(page).href);
  await browser.evaluate(`cotwin.seek(${Number(seconds)})`);
  const known = await browser.evaluate("[...document.querySelectorAll('.cue')].map((cue) => cue.dataset.cue)");
  for (const cue of cues) {
    if (!known.includes(cue)) throw new Error(`no cue '${cue}', expected one of ${known.join(', ')}`);
    await browser.evaluate(`document.querySelector('[data-cue="${cue}"] input').click()`);
    await browser.until(`cotwin.shown.has('${cue}')`);
  }
  await browser.drawn();
  await browser.evaluate('new Promise((resolve) => setTimeout(resolve, 1000))'); // the view rests at full resolution
  writeFileSync(picture, await browser.screenshot('webp'));
} finally {
  await browser.close();
}
