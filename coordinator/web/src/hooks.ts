import { useCallback, useEffect, useRef, useState } from "preact/hooks";

import { connection, explain, getJson, pause, Refused, whenUp } from "./api.ts";
import { followJob } from "./events.ts";
import type { Job } from "./model.ts";
import { useStore } from "./store.ts";

export interface Polled<T> {
  value: T | undefined;
  error: string;
  refresh: () => void;
}

/** Asks for `path` again and again, `seconds` after each answer, while the page is seen. An empty path: not at all. */
export function usePolled<T>(path: string, seconds: number): Polled<T> {
  const [value, setValue] = useState<T | undefined>(undefined);
  const [error, setError] = useState("");
  const [turn, setTurn] = useState(0);
  const refresh = useCallback(() => setTurn((n) => n + 1), []);
  useEffect(() => setValue(undefined), [path]);
  useEffect(() => {
    if (path === "") return;
    const stop = new AbortController();
    void (async () => {
      while (!stop.signal.aborted) {
        await whenUp(stop.signal);
        const begin = performance.now();
        if (document.visibilityState === "visible") {
          try {
            const next = await getJson<T>(path, stop.signal);
            if (stop.signal.aborted) return;
            setValue(next);
            setError("");
          } catch (e) {
            if (stop.signal.aborted) return;
            if (e instanceof Refused) setError(explain(e));
          }
        }
        // Long lists are asked for less often.
        await pause(Math.max(1000 * seconds, 10 * (performance.now() - begin)), stop.signal);
      }
    })();
    return () => stop.abort();
  }, [path, seconds, turn]);
  return { value, error, refresh };
}

export interface Followed {
  job: Job | undefined;
  error: string;
  /** A newer view of the job, as actions return it. */
  put: (job: Job) => void;
}

/** The job as its events tell, and looked at now and then once it has ended (it may be extended elsewhere). */
export function useJob(id: string): Followed {
  const [job, setJob] = useState<Job | undefined>(undefined);
  const [error, setError] = useState("");
  const [turn, setTurn] = useState(0);
  useEffect(() => {
    const stop = new AbortController();
    void (async () => {
      while (!stop.signal.aborted) {
        try {
          await followJob(id, setJob, stop.signal);
        } catch (e) {
          if (!stop.signal.aborted) setError(explain(e));
          return;
        }
        await pause(5000, stop.signal);
      }
    })();
    return () => stop.abort();
  }, [id, turn]);
  const put = useCallback((next: Job) => {
    setJob(next);
    setTurn((n) => n + 1);
  }, []);
  return { job, error, put };
}

/** Redraws every `seconds`: for texts like "3 s ago". */
export function useClock(seconds: number): number {
  const [now, setNow] = useState(Date.now());
  useEffect(() => {
    const timer = setInterval(() => setNow(Date.now()), 1000 * seconds);
    return () => clearInterval(timer);
  }, [seconds]);
  return now;
}

/** Grows by one each time the coordinator comes back. */
export function useReturns(): number {
  const state = useStore(connection);
  const [count, setCount] = useState(0);
  const before = useRef(state);
  useEffect(() => {
    if (before.current === "lost" && state !== "lost") setCount((n) => n + 1);
    before.current = state;
  }, [state]);
  return count;
}

/** What a counter grows by, a second, over the last few looks. */
export class RateMeter {
  private samples: { at: number; value: number }[] = [];
  private readonly window = 8000;

  /** null until two looks differ in time. */
  add(value: number, now: number): number | null {
    const last = this.samples.at(-1);
    if (last !== undefined && value < last.value) this.samples = []; // the process is a new one
    this.samples.push({ at: now, value });
    while (this.samples.length > 2 && now - (this.samples[0]?.at ?? now) > this.window) this.samples.shift();
    const first = this.samples[0];
    if (first === undefined || now - first.at < 500) return null;
    return (1000 * (value - first.value)) / (now - first.at);
  }
}

/** Rates by name. */
export function useRates(items: { name: string; value: number }[] | undefined): Map<string, number | null> {
  const meters = useRef(new Map<string, RateMeter>());
  const [rates, setRates] = useState(new Map<string, number | null>());
  useEffect(() => {
    if (items === undefined) return;
    const now = performance.now();
    const next = new Map<string, number | null>();
    for (const { name, value } of items) {
      const meter = meters.current.get(name) ?? new RateMeter();
      meters.current.set(name, meter);
      next.set(name, meter.add(value, now));
    }
    setRates(next);
    // The list is new with every look.
  }, [items]);
  return rates;
}
