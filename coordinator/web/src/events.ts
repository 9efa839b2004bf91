// A job's events: server-sent, but read by fetch, because EventSource can send no token.
import { connection, pause, Refused, send, whenUp } from "./api.ts";
import { hasEnded, type Job } from "./model.ts";

/** The coordinator breaks its silence every 15 s: after this long without a byte the connection is dead, whatever the network says. */
const kSilence = 40_000;

/** Calls `onEvent` with the data of each event until the stream ends; `onBytes` whenever anything came. */
async function readEvents(body: ReadableStream<Uint8Array>, onBytes: () => void, onEvent: (data: string) => void): Promise<void> {
  const reader = body.pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>).getReader();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    onBytes();
    rest += value;
    for (let end = rest.indexOf("\n\n"); end >= 0; end = rest.indexOf("\n\n")) {
      const data = rest
        .slice(0, end)
        .split("\n")
        .filter((line) => line.startsWith("data:"))
        .map((line) => line.slice(5).trimStart());
      rest = rest.slice(end + 2);
      if (data.length > 0) onEvent(data.join("\n"));
    }
  }
}

/** Resolves when the page is seen: hidden tabs hold no connection, of which a browser has six. */
function whenVisible(signal: AbortSignal): Promise<void> {
  if (document.visibilityState === "visible") return Promise.resolve();
  return new Promise((resolve) => {
    const done = (): void => {
      if (document.visibilityState !== "visible" && !signal.aborted) return;
      document.removeEventListener("visibilitychange", done);
      resolve();
    };
    document.addEventListener("visibilitychange", done);
    signal.addEventListener("abort", done);
  });
}

/** Follows a job until `signal` ends, over restarts of the coordinator; returns when the job has ended. Throws Refused. */
export async function followJob(id: string, onJob: (job: Job) => void, signal: AbortSignal): Promise<void> {
  let wait = 300;
  while (!signal.aborted) {
    await whenVisible(signal);
    await whenUp(signal);
    if (signal.aborted) return;
    const stream = new AbortController();
    const stop = (): void => stream.abort();
    const onHidden = (): void => {
      if (document.visibilityState === "hidden") stop();
    };
    let silence = setTimeout(stop, kSilence);
    const onBytes = (): void => {
      clearTimeout(silence);
      silence = setTimeout(stop, kSilence);
    };
    const unsubscribe = connection.subscribe(() => {
      if (connection.get() === "lost") stop();
    });
    signal.addEventListener("abort", stop);
    document.addEventListener("visibilitychange", onHidden);
    let last: Job | undefined;
    try {
      const reply = await send(`/v1/jobs/${id}/events`, { signal: stream.signal });
      if (reply.body === null) return;
      await readEvents(reply.body, onBytes, (data) => {
        last = JSON.parse(data) as Job;
        wait = 300;
        onJob(last);
      });
    } catch (error) {
      if (error instanceof Refused && error.problem.status < 500) throw error;
      if (!stream.signal.aborted && connection.get() === "up" && !(error instanceof Refused)) await probeAfterBreak();
    } finally {
      clearTimeout(silence);
      unsubscribe();
      signal.removeEventListener("abort", stop);
      document.removeEventListener("visibilitychange", onHidden);
    }
    if (last !== undefined && hasEnded(last.state)) return;
    await pause(wait, signal);
    wait = Math.min(4000, wait * 2);
  }
}

/** A stream that breaks off says nothing of why: a request finds out. */
async function probeAfterBreak(): Promise<void> {
  try {
    await send("/v1/health");
  } catch {
    // `send` has noted it.
  }
}
