// Drives Chromium by the DevTools protocol over a pipe: no further package, no port.
import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const kPatience = 120_000; // ms for one answer; a test fails for its own reasons long before, if at all

/// A page in a browser of its own. `errors`: console errors, exceptions and violations of the policy; `requests`: URLs that were asked for.
export class Browser {
  errors = [];
  requests = [];
  #next = 1;
  #waiting = new Map();
  #session;
  #process;
  #folder;

  static async start(chromium, { width = 1280, height = 800, dark = false } = {}) {
    const browser = new Browser();
    await browser.#start(chromium, width, height, dark);
    return browser;
  }

  async #start(chromium, width, height, dark) {
    this.#folder = mkdtempSync(join(tmpdir(), 'cotwin_browser_'));
    const options = ['--headless=new', '--remote-debugging-pipe', '--no-sandbox', '--disable-dev-shm-usage', '--enable-unsafe-swiftshader',
      '--disable-background-networking', '--disable-component-update', '--no-first-run', '--disable-extensions', `--window-size=${width},${height}`, `--user-data-dir=${this.#folder}`, 'about:blank'];
    this.#process = spawn(chromium, options, { stdio: ['ignore', 'ignore', 'pipe', 'pipe', 'pipe'], env: { ...process.env, HOME: this.#folder, XDG_CONFIG_HOME: this.#folder, XDG_CACHE_HOME: this.#folder } });
    let said = '';
    this.#process.stderr.on('data', (data) => { said = (said + data).slice(-4000); });
    const fail = (reason) => { for (const { reject } of this.#waiting.values()) reject(new Error(`${reason}\n${said}`)); this.#waiting.clear(); };
    this.#process.on('exit', (code) => fail(`chromium has ended (${code})`));
    this.#process.on('error', (error) => fail(`chromium cannot be started: ${error.message}`));
    let rest = Buffer.alloc(0);
    this.#process.stdio[4].on('data', (data) => {
      rest = Buffer.concat([rest, data]);
      for (let end = rest.indexOf(0); end >= 0; end = rest.indexOf(0)) {
        const message = JSON.parse(rest.subarray(0, end).toString());
        rest = rest.subarray(end + 1);
        this.#take(message);
      }
    });
    const { targetId } = await this.#send('Target.createTarget', { url: 'about:blank' }, false);
    this.#session = (await this.#send('Target.attachToTarget', { targetId, flatten: true }, false)).sessionId;
    for (const domain of ['Page', 'Runtime', 'Network', 'Log']) await this.#send(`${domain}.enable`);
    await this.look(width, height, dark);
  }

  /// The size of the window, and whether its user likes dark pages.
  async look(width, height, dark) {
    await this.#send('Emulation.setDeviceMetricsOverride', { width, height, deviceScaleFactor: 1, mobile: false });
    await this.#send('Emulation.setEmulatedMedia', { features: [{ name: 'prefers-color-scheme', value: dark ? 'dark' : 'light' }] });
  }

  #take(message) {
    if (message.id !== undefined) {
      const waiting = this.#waiting.get(message.id);
      this.#waiting.delete(message.id);
      if (message.error) waiting?.reject(new Error(`${waiting.method}: ${message.error.message}`));
      else waiting?.resolve(message.result);
      return;
    }
    const { method, params } = message;
    if (method === 'Network.requestWillBeSent') this.requests.push(params.request.url);
    if (method === 'Runtime.exceptionThrown') this.errors.push(params.exceptionDetails.exception?.description ?? params.exceptionDetails.text);
    if (method === 'Runtime.consoleAPICalled' && ['error', 'warning', 'assert'].includes(params.type))
      this.errors.push(params.args.map((value) => value.value ?? value.description).join(' '));
    if (method === 'Log.entryAdded' && params.entry.level === 'error') this.errors.push(params.entry.text);
  }

  #send(method, params = {}, of_page = true) {
    const id = this.#next++;
    const text = JSON.stringify({ id, method, params, ...(of_page ? { sessionId: this.#session } : {}) });
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => reject(new Error(`${method}: no answer within ${kPatience / 1000} s`)), kPatience);
      const settle = (action) => (value) => { clearTimeout(timer); action(value); };
      this.#waiting.set(id, { method, resolve: settle(resolve), reject: settle(reject) });
      this.#process.stdio[3].write(`${text}\0`);
    });
  }

  /// Opens a file and waits until it is ready: the page of `cotwin view`, also if it has failed. Returns the milliseconds from the start of loading.
  async open(url, ready = "document.documentElement?.dataset.ready === 'true' || document.querySelector('.failure') !== null") {
    // From the same file with another #, the browser would not load it again.
    await this.#send('Page.navigate', { url: 'about:blank' });
    await this.until("location.href === 'about:blank'");
    this.errors.length = this.requests.length = 0;
    const begin = Date.now();
    await this.#send('Page.navigate', { url });
    await this.until(`location.href !== 'about:blank' && (${ready})`);
    return Date.now() - begin;
  }

  /// The value of an expression in the page; promises are awaited.
  async evaluate(expression) {
    const { result, exceptionDetails } = await this.#send('Runtime.evaluate', { expression, awaitPromise: true, returnByValue: true });
    if (exceptionDetails) throw new Error(`${expression}: ${exceptionDetails.exception?.description ?? exceptionDetails.text}`);
    return result.value;
  }

  async until(expression) {
    const end = Date.now() + kPatience;
    while (!(await this.evaluate(expression))) {
      if (Date.now() > end) throw new Error(`not within ${kPatience / 1000} s: ${expression}`);
      await new Promise((resolve) => setTimeout(resolve, 20));
    }
  }

  /// Waits until the page has drawn what was asked for before.
  async drawn() {
    await this.evaluate('new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => resolve(true))))');
  }

  async key(key, { shift = false } = {}) {
    const text = key.length === 1 ? key : undefined;
    const common = { key, code: key === ' ' ? 'Space' : key, modifiers: shift ? 8 : 0, windowsVirtualKeyCode: key.length === 1 ? key.toUpperCase().charCodeAt(0) : 0 };
    await this.#send('Input.dispatchKeyEvent', { type: 'keyDown', ...common, ...(text ? { text } : {}) });
    await this.#send('Input.dispatchKeyEvent', { type: 'keyUp', ...common });
    await this.drawn();
  }

  async mouse(type, x, y, { button = 'left', delta = 0, shift = false } = {}) {
    await this.#send('Input.dispatchMouseEvent', { type, x, y, button: type === 'mouseWheel' ? 'none' : button, buttons: type === 'mouseReleased' ? 0 : 1, clickCount: 1, deltaX: 0, deltaY: delta, modifiers: shift ? 8 : 0 });
  }

  /// `clip`: { x, y, width, height, scale }; without it the whole window.
  async screenshot(format = 'png', clip = undefined) {
    return Buffer.from((await this.#send('Page.captureScreenshot', { format, clip, quality: format === 'png' ? undefined : 80 })).data, 'base64');
  }

  async close() {
    const ended = new Promise((resolve) => this.#process.once('exit', resolve));
    this.#send('Browser.close', {}, false).catch(() => {});
    const timer = setTimeout(() => this.#process.kill('SIGKILL'), 10_000);
    await ended;
    clearTimeout(timer);
    rmSync(this.#folder, { recursive: true, force: true, maxRetries: 5, retryDelay: 100 });
  }
}
