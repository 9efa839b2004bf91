// Fetching a job's image while it refines.
import { useEffect, useRef, useState } from "preact/hooks";

import { explain, pause, Refused, send, whenUp } from "./api.ts";
import { hasEnded, isActive, type Job } from "./model.ts";
import type { Pixels } from "./tone.ts";

/** One layer; the same object when nothing changed since `before`. */
export async function fetchPixels(id: string, layer: string, maxWidth: number, signal: AbortSignal, before?: Fetched): Promise<Fetched> {
  const query = new URLSearchParams({ layer, max_width: String(maxWidth) });
  const headers: Record<string, string> = before ? { "If-None-Match": before.etag } : {};
  const reply = await send(`/v1/jobs/${id}/pixels?${query}`, { signal, headers });
  if (reply.status === 304 && before) return before;
  const number = (name: string): number => Number(reply.headers.get(`Photonfarm-${name}`));
  return {
    etag: reply.headers.get("ETag") ?? "",
    pixels: {
      width: number("Width"),
      height: number("Height"),
      passes: number("Passes"),
      rgb: new Uint16Array(await reply.arrayBuffer()),
    },
  };
}

export interface Fetched {
  etag: string;
  pixels: Pixels;
}

/**
 * An image of n sub-passes looks different only when n has grown by a share of itself: a new one is fetched after a tenth more, so
 * that a watcher of a long job costs next to nothing. But never later than some seconds after a change.
 */
const kGrowth = 1.1;
const kLeastPause = 700;
const kLongestPause = 15_000;

export interface LiveLayers {
  /** Those that `layers` are; the former ones until the new ones have come. */
  names: string[];
  layers: Pixels[];
  error: string;
}

/** The named layers of the job, all of one moment as far as the coordinator has them, while the page is seen. */
export function useLiveLayers(job: Job | undefined, names: string[], maxWidth: number): LiveLayers {
  const [shown, setShown] = useState<LiveLayers>({ names: [], layers: [], error: "" });
  const latest = useRef(job);
  latest.current = job;
  const key = names.join("\n");
  const id = job?.id ?? "";
  useEffect(() => {
    if (id === "" || key === "") return;
    const stop = new AbortController();
    void (async () => {
      let have: Fetched[] = [];
      let last = -Infinity;
      let least = kLeastPause;
      let endedBefore = false;
      while (!stop.signal.aborted) {
        await whenUp(stop.signal);
        const now = latest.current;
        if (now !== undefined && document.visibilityState === "visible" && isDue(now, have, performance.now() - last, least, endedBefore)) {
          endedBefore = hasEnded(now.state);
          last = performance.now();
          try {
            const next = await Promise.all(key.split("\n").map((name, i) => fetchPixels(id, name, maxWidth, stop.signal, have[i])));
            if (stop.signal.aborted) return;
            if (next.some((fetched, i) => fetched !== have[i])) setShown({ names: key.split("\n"), layers: next.map((f) => f.pixels), error: "" });
            // The coordinator makes a new image only so often: asking for it again and again would cost it the more.
            least = next.every((fetched, i) => fetched === have[i]) ? Math.min(2 * least, kLongestPause) : kLeastPause;
            have = next;
          } catch (error) {
            if (stop.signal.aborted) return;
            if (error instanceof Refused) setShown((s) => ({ ...s, error: explain(error) }));
          }
        }
        await pause(200, stop.signal);
      }
    })();
    return () => stop.abort();
  }, [id, key, maxWidth]);
  return shown;
}

function isDue(job: Job, have: Fetched[], sinceLast: number, least: number, endedBefore: boolean): boolean {
  if (sinceLast < kLeastPause) return false;
  const passes = have[0]?.pixels.passes;
  if (passes === undefined) return job.passes_done > 0 || sinceLast > 5000;
  if (hasEnded(job.state) !== endedBefore) return true;
  if (sinceLast < least) return false;
  if (passes === job.passes_done) return false;
  return job.passes_done < passes || job.passes_done >= kGrowth * passes || sinceLast > kLongestPause || !isActive(job.state);
}
