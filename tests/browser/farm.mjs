// A real farm for the browser's tests: engine, coordinator and two workers, as `photonfarm farm` starts them.
import { spawn } from "node:child_process";
import { createHash } from "node:crypto";
import { mkdtempSync, openSync, readdirSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

/** Asks until `condition` gives something, or fails when `seconds` are over. */
export async function until(what, condition, seconds = 30) {
  const end = Date.now() + 1000 * seconds;
  for (;;) {
    const value = await condition();
    if (value) return value;
    if (Date.now() > end) throw new Error(`not within ${seconds} s: ${what}`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

const textOf = (file) => {
  try {
    return readFileSync(file, "utf8").trim();
  } catch {
    return "";
  }
};

export class Farm {
  static async start(bin, workers = 2) {
    const farm = new Farm();
    farm.folder = mkdtempSync(join(tmpdir(), "photonfarm-browser-"));
    farm.state = join(farm.folder, "state");
    const log = openSync(join(farm.folder, "farm.log"), "w");
    const arguments_ = ["farm", "--workers", String(workers), "--threads", "1", "--state", farm.state];
    farm.process = spawn(join(bin, "photonfarm"), arguments_, { stdio: ["ignore", log, log] });
    await until("the farm's address", () => farm.url !== "" && farm.token !== "");
    await until("the workers", async () => (await farm.workers()).length === workers);
    return farm;
  }

  get url() {
    return textOf(join(this.state, "url"));
  }
  get token() {
    return textOf(join(this.state, "token"));
  }
  get log() {
    return textOf(join(this.folder, "farm.log"));
  }

  async get(path) {
    const reply = await fetch(this.url + path, { headers: { Authorization: `Bearer ${this.token}` } });
    if (!reply.ok) throw new Error(`${path}: ${reply.status} ${await reply.text()}`);
    return reply.json();
  }
  async workers() {
    try {
      return (await this.get("/v1/workers")).workers.filter((w) => w.state !== "lost");
    } catch {
      return []; // the coordinator is not there yet
    }
  }
  job(id) {
    return this.get(`/v1/jobs/${id}`);
  }

  /** Submits without the page; `scene` is a file, `spec` the job model. */
  async submit(spec, scene) {
    const content = readFileSync(scene);
    const sha256 = createHash("sha256").update(content).digest("hex");
    const headers = { Authorization: `Bearer ${this.token}`, "Content-Type": "application/json" };
    await fetch(`${this.url}/v1/blobs/${sha256}`, { method: "PUT", headers, body: content });
    const body = JSON.stringify({ spec, files: [{ path: spec.scene.file, sha256, bytes: content.length }] });
    const reply = await fetch(`${this.url}/v1/jobs`, { method: "POST", headers, body });
    if (!reply.ok) throw new Error(await reply.text());
    return (await reply.json()).id;
  }

  /** The processes that the farm started, by the name of their program. */
  children(program) {
    const found = [];
    for (const entry of readdirSync("/proc")) {
      if (!/^\d+$/.test(entry)) continue;
      // "PID (NAME) STATE PARENT ...": the name may hold blanks.
      const stat = textOf(`/proc/${entry}/stat`);
      const parent = Number(stat.slice(stat.lastIndexOf(")") + 2).split(" ")[1]);
      const words = textOf(`/proc/${entry}/cmdline`).split("\0");
      if (parent === this.process.pid && words[0]?.endsWith(`/${program}`)) found.push(Number(entry));
    }
    return found;
  }

  async stop() {
    const ended = new Promise((resolve) => this.process.once("exit", resolve));
    if (this.process.exitCode === null) {
      this.process.kill("SIGTERM");
      await ended;
    }
    rmSync(this.folder, { recursive: true, force: true });
  }
}
