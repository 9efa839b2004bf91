// Headless Chromium, and what a test asks of a page. Whatever a page complains of fails the test that looks.
import { existsSync, mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { delimiter, join } from "node:path";

const require = createRequire(join(process.env.PF_BROWSER_PACKAGES, "package.json"));
const puppeteer = require("puppeteer-core");
const axe = require("axe-core");

/** Debian's headless shell is the smaller one; the whole browser does as well. */
const kPrograms = ["chromium-headless-shell", "chromium"];

function findChromium() {
  const folders = (process.env.PATH ?? "").split(delimiter);
  for (const program of kPrograms) {
    for (const folder of folders) {
      if (existsSync(join(folder, program))) return join(folder, program);
    }
  }
  throw new Error(`no ${kPrograms.join(" or ")} here; expected Debian's package chromium-headless-shell: deploy/install --tests brings it`);
}

export const kWide = { width: 1360, height: 900 };
export const kPhone = { width: 360, height: 740, isMobile: true, hasTouch: true };

export class Browser {
  static async start() {
    const browser = new Browser();
    browser.chromium = await puppeteer.launch({
      executablePath: findChromium(),
      headless: "shell",
      // Tests run as root in containers too, where Chromium's sandbox cannot; the pages are our own.
      args: ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"],
      protocolTimeout: 60_000,
    });
    return browser;
  }
  async open(address, viewport = kWide) {
    const context = await this.chromium.createBrowserContext();
    const page = new Page();
    page.page = await context.newPage();
    page.watch();
    await page.page.setViewport(viewport);
    await page.page.goto(address);
    return page;
  }
  stop() {
    return this.chromium.close();
  }
}

export class Page {
  problems = [];

  watch() {
    this.page.on("pageerror", (error) => this.problems.push(`exception: ${error.message}`));
    this.page.on("console", (message) => {
      // The browser itself notes every answer that is no success; what the page does about it is looked at.
      if (message.type() === "error" && !message.text().startsWith("Failed to load resource")) this.problems.push(message.text());
    });
    this.page.on("request", (request) => {
      const host = new URL(request.url()).hostname;
      if (host !== "127.0.0.1" && !request.url().startsWith("blob:")) this.problems.push(`a request to ${request.url()}`);
    });
  }

  /** Waits until `test`, in the page, gives something. */
  async until(what, test, ...values) {
    try {
      const handle = await this.page.waitForFunction(test, { polling: 50, timeout: 30_000 }, ...values);
      return await handle.jsonValue();
    } catch (error) {
      const text = await this.page.evaluate(() => document.body.innerText).catch(() => "");
      throw new Error(`${what}: ${error.message}\nThe page says:\n${text.slice(0, 1500)}`);
    }
  }
  text(what) {
    return this.until(`the text ${what}`, (t) => document.body.innerText.includes(t), what);
  }
  heading(text) {
    return this.until(`the heading ${text}`, (t) => document.querySelector("h1")?.textContent === t, text);
  }
  state(state) {
    return this.until(`the state ${state}`, (s) => document.querySelector(".status-state")?.dataset.state === s, state);
  }
  passes() {
    return this.page.evaluate(() => Number(document.querySelector("[data-fact=passes]").textContent.replaceAll(/\D/g, "")));
  }
  /** Passes go beyond what they were. */
  async progress(from) {
    const begin = from ?? (await this.passes());
    return this.until(`more sub-passes than ${begin}`, (b) => {
      const passes = Number(document.querySelector("[data-fact=passes]").textContent.replaceAll(/\D/g, ""));
      return passes > b && passes;
    }, begin);
  }
  /** Clicks a button by its name, as it is read out. */
  async click(name) {
    const element = await this.page.locator(`::-p-aria([name="${name}"][role="button"])`).setTimeout(15_000).waitHandle();
    await element.click();
  }
  async type(selector, text) {
    const element = await this.page.waitForSelector(selector);
    if (!(await element.evaluate((e) => e instanceof HTMLInputElement))) return this.page.locator(selector).fill(text);
    // fill() empties the field without telling the page, which then may put back what it held before the first key comes.
    await element.evaluate((e) => (e.focus(), e.select()));
    await this.page.keyboard.type(text);
  }
  /** A number that tells images apart. */
  picture() {
    return this.page.evaluate(() => {
      const canvas = document.querySelector(".stage canvas");
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      let hash = 0;
      for (const byte of data) hash = (Math.imul(hash, 31) + byte) | 0;
      return hash;
    });
  }
  pictureChanges(from) {
    return this.until("another picture", (before) => {
      const canvas = document.querySelector(".stage canvas");
      if (canvas === null || canvas.hidden) return false;
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      let hash = 0;
      for (const byte of data) hash = (Math.imul(hash, 31) + byte) | 0;
      return hash !== before && [hash];
    }, from);
  }

  go(route) {
    return this.page.evaluate((r) => void (location.hash = r), route);
  }

  /** Rules of WCAG 2.2 A and AA that axe can check. */
  async accessibility() {
    await this.page.evaluate(axe.source);
    const tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"];
    const { violations } = await this.page.evaluate((t) => axe.run(document, { runOnly: t }), tags);
    return violations.map((v) => `${v.id}: ${v.help}: ${v.nodes.map((n) => `${n.html} ${n.any[0]?.message ?? ""}`).join("; ")}`);
  }
  scrollsSideways() {
    return this.page.evaluate(() => document.documentElement.scrollWidth > document.documentElement.clientWidth);
  }
  scheme(value) {
    return this.page.emulateMediaFeatures([{ name: "prefers-color-scheme", value }]);
  }
  /** Into PF_SCREENSHOTS, if that is set: for people. */
  async shot(name, fullPage = true) {
    const folder = process.env.PF_SCREENSHOTS;
    if (!folder) return;
    mkdirSync(folder, { recursive: true });
    await this.page.screenshot({ path: join(folder, `${name}.png`), fullPage });
  }
}
