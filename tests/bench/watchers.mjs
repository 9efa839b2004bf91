#!/usr/bin/env node
// What clients of the dashboard cost a job: sub-passes/s alone and with N of them, in turns within one run, and what the
// coordinator takes of the processors.   node tests/bench/watchers.mjs [--bin DIR] [--clients 50] [--window 15] [--turns 4]
// A client asks what the page asks: events, pixels as the image refines, log, convergence, workers. All run on this machine, so
// that the sub-passes that they cost include what the clients themselves take of it: what the coordinator takes more of the
// processors is what they would cost a job from machines of their own.
import { readFileSync } from "node:fs";
import { cpus } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { parseArgs } from "node:util";

import { Farm, until } from "../browser/farm.mjs";

const root = join(dirname(fileURLToPath(import.meta.url)), "../..");
const text = (value) => ({ type: "string", default: value });
const options = { bin: text(join(root, "build/release/bin")), clients: text("50"), window: text("15"), turns: text("4") };
const { values } = parseArgs({ options });
const kClients = Number(values.clients), kWindow = Number(values.window), kTurns = Number(values.turns);
const kTicks = 100; // a second, of /proc
const pause = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));

const kSpec = {
  spec_version: 1,
  job: { name: "watched" },
  scene: { file: "scenes/peer-box.glb" },
  image: { width: 640, height: 480 },
  integrator: { type: "sppm", photons: 100000 },
  stop: { passes: 1000000 },
};

/** One page, until `signal` ends; what it does is in coordinator/web/src (events.ts, pixels.ts). */
async function client(farm, id, signal, counts) {
  const get = async (path, headers = {}) => {
    const reply = await fetch(farm.url + path, { headers: { Authorization: `Bearer ${farm.token}`, ...headers }, signal });
    ++counts.requests;
    return reply;
  };
  const repeat = async (path, seconds) => {
    while (!signal.aborted) {
      await (await get(path)).arrayBuffer();
      await pause(seconds);
    }
  };
  const log = async () => {
    let after = 0;
    while (!signal.aborted) {
      const lines = (await (await get(`/v1/jobs/${id}/logs?after=${after}`)).text()).split("\n").filter((line) => line !== "");
      if (lines.length > 0) after = JSON.parse(lines.at(-1)).number;
      await pause(3);
    }
  };
  let job;
  const watch = async () => {
    const reply = await get(`/v1/jobs/${id}/events`);
    let rest = "";
    for await (const piece of reply.body.pipeThrough(new TextDecoderStream())) {
      rest += piece;
      for (let end = rest.indexOf("\n\n"); end >= 0; end = rest.indexOf("\n\n")) {
        const data = /^data: (.*)$/m.exec(rest.slice(0, end));
        if (data !== null) job = JSON.parse(data[1]);
        rest = rest.slice(end + 2);
        ++counts.events;
      }
    }
  };
  const draw = async () => {
    let passes = 0, last = -Infinity, least = 700, etag = "";
    while (!signal.aborted) {
      const since = performance.now() - last;
      const due = job !== undefined && since > least && job.passes_done > passes && (job.passes_done >= 1.1 * passes || since > 15_000);
      if (due) {
        last = performance.now();
        const reply = await get(`/v1/jobs/${id}/pixels?layer=beauty&max_width=640`, etag === "" ? {} : { "If-None-Match": etag });
        counts.bytes += (await reply.arrayBuffer()).byteLength;
        least = reply.status === 304 ? Math.min(2 * least, 15_000) : 700;
        if (reply.status === 304) continue;
        etag = reply.headers.get("ETag");
        passes = Number(reply.headers.get("Photonfarm-Passes"));
        ++counts.images;
      }
      await pause(0.2);
    }
  };
  const quiet = (promise) => promise.catch((error) => void (signal.aborted || (counts.failed = String(error))));
  await Promise.all([watch(), draw(), log(), repeat(`/v1/jobs/${id}/convergence`, 5), repeat("/v1/workers", 4)].map(quiet));
}

const cpuSeconds = (pid) => {
  const stat = readFileSync(`/proc/${pid}/stat`, "utf8");
  const fields = stat.slice(stat.lastIndexOf(")") + 2).split(" ");
  return (Number(fields[11]) + Number(fields[12])) / kTicks;
};

async function measure(farm, id, pid) {
  const [job, cpu, begin] = [await farm.job(id), cpuSeconds(pid), performance.now()];
  await pause(kWindow);
  const seconds = (performance.now() - begin) / 1000;
  return { passes: ((await farm.job(id)).passes_done - job.passes_done) / seconds, share: (cpuSeconds(pid) - cpu) / seconds / cpus().length };
}

const mean = (list, key) => list.reduce((sum, m) => sum + m[key], 0) / list.length;
const farm = await Farm.start(values.bin);
try {
  const id = await farm.submit(kSpec, join(root, "jobs/scenes/peer-box.glb"));
  await until("some sub-passes", async () => (await farm.job(id)).passes_done >= 20, 120);
  const [pid] = farm.children("photonfarm-coordinator");
  const alone = [], watched = [], counts = { requests: 0, events: 0, images: 0, bytes: 0, failed: "" };
  const own = process.cpuUsage();
  for (let turn = 0; turn < kTurns; ++turn) {
    alone.push(await measure(farm, id, pid));
    const stop = new AbortController();
    const clients = Array.from({ length: kClients }, () => client(farm, id, stop.signal, counts));
    watched.push(await measure(farm, id, pid));
    stop.abort();
    await Promise.all(clients);
  }
  const used = process.cpuUsage(own);
  const percent = (value) => `${(100 * value).toFixed(2)} %`;
  console.log(`sub-passes/s alone ${mean(alone, "passes").toFixed(3)}, with ${kClients} clients ${mean(watched, "passes").toFixed(3)}: ${percent(1 - mean(watched, "passes") / mean(alone, "passes"))} fewer`);
  console.log(`coordinator's share of ${cpus().length} processors alone ${percent(mean(alone, "share"))}, with clients ${percent(mean(watched, "share"))}`);
  console.log(`the clients themselves took ${percent((used.user + used.system) / 1e6 / (kTurns * kWindow) / cpus().length)} of the processors while they ran`);
  console.log(`${counts.requests} requests, ${counts.events} events, ${counts.images} images, ${(counts.bytes / 1e6).toFixed(0)} MB${counts.failed && `, failed: ${counts.failed}`}`);
} finally {
  await farm.stop();
}
