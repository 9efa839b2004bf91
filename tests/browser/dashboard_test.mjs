// The dashboard as a person uses it, in a real browser against a real farm. The tests run in this order and share both.
import assert from "node:assert/strict";
import { after, afterEach, before, test } from "node:test";
import { join } from "node:path";

import { Browser, kPhone } from "./browser.mjs";
import { Farm, until } from "./farm.mjs";

const { PF_BIN, PF_SCENES } = process.env;
let farm, browser, page, id;

/** Small enough to begin at once. */
const spec = (name, passes) => `spec_version = 1
[job]
name = "${name}"
[scene]
file = "scenes/peer-box.glb"
[image]
width = 96
height = 96
[integrator]
type = "sppm"
photons = 20000
error_estimate = true
[stop]
passes = ${passes}
[checkpoint]
seconds = 1
`;
const kEndless = 1_000_000;

async function submit(name, passes) {
  await page.go("#/submit");
  await page.heading("Submit a job");
  await page.type("textarea", spec(name, passes));
  const input = await page.page.waitForSelector("input[type=file][multiple]");
  await input.uploadFile(join(PF_SCENES, "peer-box.glb"));
  await page.until("a valid job", () => document.querySelector(".verdict")?.dataset.verdict === "good");
  await page.until("a button that may be pressed", () => !document.querySelector("button[type=submit]").disabled);
  await page.click("Submit");
  await page.heading(name);
  return page.page.evaluate(() => location.hash.split("/").at(-1));
}

before(async () => {
  farm = await Farm.start(PF_BIN);
  browser = await Browser.start();
  page = await browser.open(farm.url);
});
after(async () => {
  await browser?.stop();
  await farm?.stop();
});
afterEach(() => {
  // Also what the content security policy refused is said on the console.
  assert.deepEqual(page.problems.splice(0), []);
});

test("a token is asked for, and a wrong one refused", async () => {
  await page.heading("Sign in");
  await page.shot("sign-in");
  await page.type("input[name=token]", "0123456789abcdef");
  await page.click("Sign in");
  await page.text("This token is not known here.");
});

test("a link signs in, and its token stays in no history", async () => {
  await page.go(`#token=${farm.token}`);
  await page.heading("Jobs");
  await page.text("No jobs yet");
  await page.shot("no-jobs");
  assert.equal(await page.page.evaluate(() => location.hash), "#/");
});

test("the job file is checked while it is typed, and the place of an error shown", async () => {
  await page.go("#/submit");
  await page.heading("Submit a job");
  await page.type("textarea", spec("typed", 64).replace("sppm", "sppn"));
  await page.text("Line 10, column 1");
  assert.equal(await page.page.evaluate(() => document.querySelector(".gutter .bad").textContent), "10");
  await page.shot("submit-error");
  await page.type("textarea", spec("typed", 64).replace("height = 96", "height = "));
  await page.text("Line 8, column");
  assert.ok(await page.page.evaluate(() => document.querySelector("button[type=submit]").disabled));
});

test("a job is submitted with its scene, and its picture converges", async () => {
  id = await submit("box", kEndless);
  const [first] = await page.pictureChanges(0);
  await page.pictureChanges(first);
  await page.state("running");
});

test("layers, exposure and the error map are looked at", async () => {
  const look = (key) =>
    page.until(`the layer ${key}`, (k) => document.querySelector(".stage canvas").dataset.look === k && Number(document.querySelector(".stage canvas").dataset.passes) > 0, key);
  await page.click("Pause");
  await page.state("paused");
  const before = await page.until("a picture of all sub-passes", () => {
    const canvas = document.querySelector(".stage canvas");
    const done = Number(document.querySelector("[data-fact=passes]").textContent.replaceAll(/\D/g, ""));
    return Number(canvas.dataset.passes) === done && done;
  }).then(() => page.picture());
  await page.page.focus(".exposure input");
  await page.page.keyboard.press("ArrowRight");
  const [brighter] = await page.pictureChanges(before);
  await page.page.select(".viewer-controls select", "caustics");
  await look("caustics");
  await page.pictureChanges(brighter);
  await page.page.select(".viewer-controls select", "error");
  await look("error");
  await page.text("Estimated relative error");
  await page.shot("error-map", false);
  await page.page.select(".viewer-controls select", "beauty");
  await look("beauty");
});

test("a paused job stands still, and resumed it goes on", async () => {
  const paused = (await farm.job(id)).passes_done;
  assert.equal(await page.passes(), paused);
  await page.click("Resume");
  await page.state("running");
  await page.progress(paused);
});

test("the error is drawn against time, the log followed", async () => {
  await page.until("a chart", () => document.querySelector(".chart-panel canvas") !== null);
  await page.until("points", () => document.querySelectorAll(".points tbody tr").length >= 2);
  await page.until("the log", () => document.querySelectorAll(".log li").length > 0);
  await page.shot("job");
});

test("a worker that dies is seen, and the picture goes on", async () => {
  await page.go("#/workers");
  await page.until("two workers", () => document.querySelectorAll(".workers tbody tr").length >= 2);
  await page.shot("workers");
  const [victim] = farm.children("photonfarm-worker");
  await page.text(`process ${victim}`);
  process.kill(victim, "SIGKILL");
  // Its successor has its name and another process; or the farm says that it is lost.
  await page.until("another process, or the loss", (pid) => {
    const text = document.querySelector(".workers").innerText;
    return !text.includes(`process ${pid}`) || text.includes("lost");
  }, victim);
  await page.go(`#/jobs/${id}`);
  await page.state("running");
  await page.progress();
});

test("a worker is drained, and takes units again", async () => {
  await page.go("#/workers");
  const { name } = (await farm.workers())[0];
  await page.click(`Drain ${name}`);
  await page.until("a drained worker", (n) => {
    const row = [...document.querySelectorAll(".workers tbody tr")].find((r) => r.innerText.includes(n));
    return /drain/.test(row?.querySelector("[data-label=State]")?.innerText ?? "");
  }, name);
  await page.click(`Enable ${name}`);
  await until("the worker's return", async () => (await farm.workers()).some((w) => w.name === name && !/drain|disabled/.test(w.state)));
});

test("a coordinator that dies is told, and the page comes back by itself", async () => {
  await page.go(`#/jobs/${id}`);
  await page.state("running");
  await page.progress();
  // Beyond the last checkpoint sub-passes are traced again.
  const [coordinator] = farm.children("photonfarm-coordinator");
  process.kill(coordinator, "SIGKILL");
  await page.until("word of it", () => document.querySelector(".connection").dataset.connection === "lost");
  await page.shot("connection-lost", false);
  await page.until("the connection", () => document.querySelector(".connection").dataset.connection === "up");
  await page.state("running");
  const passes = await page.passes();
  await page.progress(passes);
});

test("priority is changed", async () => {
  await page.click("Priority…");
  await page.type("dialog input", "70");
  await page.click("Change");
  await until("the new priority", async () => (await farm.job(id)).priority === 70);
});

test("cancelling asks first, and keeps the picture when told so", async () => {
  await page.click("Cancel…");
  await page.text("Cancel, keep the image");
  await page.shot("cancel", false);
  await page.page.keyboard.press("Escape");
  await page.until("no question", () => document.querySelector("dialog") === null);
  assert.equal((await farm.job(id)).state, "running");
  await page.click("Cancel…");
  await page.click("Cancel, keep the image");
  await page.state("cancelled");
  await page.text("EXR, all layers");
  const { passes_done } = await farm.job(id);
  await page.until("the last picture", (n) => Number(document.querySelector(".stage canvas").dataset.passes) === n, passes_done);
});

test("a cancelled job is tried again, and its picture discarded", async () => {
  await page.click("Retry");
  await page.state("running");
  await page.progress();
  await page.click("Cancel…");
  await page.click("Cancel, discard the image");
  await page.state("cancelled");
  await page.go("#/");
  await page.heading("Jobs");
  await page.go(`#/jobs/${id}`);
  await page.until("the word that there is no image", () => document.querySelector(".stage-empty")?.textContent === "The image was discarded.");
  assert.ok(await page.page.evaluate(() => document.querySelector(".downloads") === null), "nothing to download");
});

test("a job that is done is extended", async () => {
  const short = await submit("short", 8);
  await page.state("done");
  assert.equal(await page.passes(), 8);
  await page.click("Extend…");
  await page.type("dialog input", "16");
  await page.click("Extend");
  await until("16 sub-passes", async () => (await farm.job(short)).passes_done === 16);
  await page.state("done");
  await page.shot("job-done");
});

test("every page is fit for assistive technology, for both schemes and a phone's width", async () => {
  const routes = { jobs: "#/", job: `#/jobs/${id}`, workers: "#/workers", submit: "#/submit" };
  const phone = await browser.open(`${farm.url}/#token=${farm.token}`, kPhone);
  for (const [name, route] of Object.entries(routes)) {
    for (const scheme of ["light", "dark"]) {
      for (const [device, seen] of [["wide", page], ["phone", phone]]) {
        await seen.scheme(scheme);
        await seen.go(route);
        await seen.until("the page", (r) => location.hash === r && document.querySelector("h1") !== null && document.querySelector(".loading") === null, route);
        assert.deepEqual(await seen.accessibility(), [], `${name}, ${scheme}, ${device}`);
        assert.equal(await seen.scrollsSideways(), false, `${name}, ${device}: scrolls sideways`);
        await seen.shot(`${name}-${scheme}-${device}`);
      }
    }
  }
  assert.deepEqual(phone.problems, []);
});

test("files have strict headers, and a changed page's old files are not kept for new ones", async () => {
  const reply = await fetch(farm.url);
  assert.match(reply.headers.get("content-security-policy"), /default-src 'none'.*frame-ancestors 'none'/);
  assert.equal(reply.headers.get("x-content-type-options"), "nosniff");
  assert.equal(reply.headers.get("referrer-policy"), "no-referrer");
  assert.equal(reply.headers.get("cache-control"), "no-cache");
  const again = await fetch(farm.url, { headers: { "If-None-Match": reply.headers.get("etag") } });
  assert.equal(again.status, 304);
  const [, script] = /src="([^"]+)"/.exec(await reply.text());
  assert.match((await fetch(farm.url + script)).headers.get("cache-control"), /immutable/);
});
