// view.mjs CHROMIUM PAGE [SIGNAL]: opens a page of `cotwin view` and prints, as one JSON object, the milliseconds until it is ready, and those per
// frame (mean) while it plays; with SIGNAL also those per frame (median, 95 %) while the plot of that signal pans.
import { pathToFileURL } from 'node:url';
import { Browser } from '../../master/view/page/test/browser.mjs';

const [chromium, page, signal] = process.argv.slice(2);
const browser = await Browser.start(chromium);
try {
  const figures = { ready: await browser.open(pathToFileURL(page).href) };
  await browser.key('Home');
  await browser.key(' ');
  await new Promise((resolve) => setTimeout(resolve, 5000));
  figures.frame = 1000 / (await browser.evaluate('cotwin.rate'));
  figures.scale = await browser.evaluate('cotwin.stage?.scale ?? 0');
  await browser.key(' ');
  if (signal !== undefined) {
    // The range is a fifth of the recording; it moves by a hundredth of itself per frame.
    const frames = await browser.evaluate(`new Promise((resolve) => {
      const { range } = cotwin;
      range.zoom(0.2, range.begin);
      const times = [];
      const step = (now) => {
        times.push(now);
        range.move((range.to - range.from) / 100);
        cotwin.draw_plots();
        if (times.length < 200) requestAnimationFrame(step);
        else resolve(times.slice(1).map((t, i) => t - times[i]).sort((a, b) => a - b));
      };
      requestAnimationFrame(step);
    })`);
    figures.pan = frames[Math.floor(frames.length / 2)];
    figures.pan_95 = frames[Math.floor(frames.length * 0.95)];
  }
  if (browser.errors.length > 0) throw new Error(`the console says: ${browser.errors.join('; ')}`);
  console.log(JSON.stringify(figures));
} finally {
  await browser.close();
}
