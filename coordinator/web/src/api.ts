// Requests to the coordinator: the token, errors, and whether it is there at all.
import type { Problem } from "./model.ts";
import { makeStore } from "./store.ts";

const kTokenKey = "photonfarm-token";

export const token = makeStore<string>(sessionStorage.getItem(kTokenKey) ?? "");
/** "lost": the coordinator does not answer; requests wait for it. "outdated": it came back as another build than this page. */
export const connection = makeStore<"up" | "lost" | "outdated">("up");

export function signIn(value: string): void {
  sessionStorage.setItem(kTokenKey, value);
  token.set(value);
}
export function signOut(): void {
  sessionStorage.removeItem(kTokenKey);
  token.set("");
}

/** Takes the token out of `#token=...` (and what follows `&to=` becomes the route), so that it stays in no history. */
export function takeTokenFromFragment(): void {
  const match = /^#token=([^&]+)(?:&to=(.*))?$/.exec(location.hash);
  if (match === null) return;
  signIn(decodeURIComponent(match[1] ?? ""));
  history.replaceState(null, "", `${location.pathname}#${match[2] ?? "/"}`);
}

/** The coordinator said no, and why. */
export class Refused extends Error {
  readonly problem: Problem;
  constructor(problem: Problem) {
    super(problem.detail);
    this.problem = problem;
  }
}

/** Resolves after `milliseconds`, or at once when `signal` ends. */
export function pause(milliseconds: number, signal?: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, milliseconds);
    signal?.addEventListener("abort", () => {
      clearTimeout(timer);
      resolve();
    });
  });
}

let build = "";
let probing = false;

/** Asks until the coordinator answers. */
async function probe(): Promise<void> {
  if (probing) return;
  probing = true;
  for (let wait = 400; ; wait = Math.min(4000, wait * 1.5)) {
    try {
      const reply = await fetch("/v1/health", { cache: "no-store" });
      if (reply.ok) {
        const health = (await reply.json()) as { build_id: string };
        const same = build === "" || build === health.build_id;
        build ||= health.build_id;
        connection.set(same ? "up" : "outdated");
        break;
      }
    } catch {
      // Not there yet.
    }
    connection.set("lost");
    await pause(wait);
  }
  probing = false;
}

/** Learns which build serves, so that another one is noticed. */
export function meetCoordinator(): void {
  void probe();
}

function noteLost(): void {
  connection.set("lost");
  void probe();
}

/** Resolves when the coordinator is there. */
export function whenUp(signal?: AbortSignal): Promise<void> {
  if (connection.get() !== "lost" || signal?.aborted) return Promise.resolve();
  return new Promise((resolve) => {
    const done = (): void => {
      if (connection.get() === "lost" && !signal?.aborted) return;
      unsubscribe();
      resolve();
    };
    const unsubscribe = connection.subscribe(done);
    signal?.addEventListener("abort", done);
  });
}

async function problemOf(reply: Response): Promise<Problem> {
  const fallback = { type: "", title: reply.statusText, status: reply.status, detail: `the coordinator answered ${reply.status}` };
  try {
    return { ...fallback, ...((await reply.json()) as Partial<Problem>) };
  } catch {
    return fallback;
  }
}

/** Any request; throws Refused, or TypeError when there is no answer. 304 is an answer. */
export async function send(path: string, init: RequestInit = {}): Promise<Response> {
  const headers = new Headers(init.headers);
  const used = token.get();
  headers.set("Authorization", `Bearer ${used}`);
  let reply: Response;
  for (;;) {
    try {
      reply = await fetch(path, { cache: "no-store", ...init, headers });
    } catch (error) {
      if (!init.signal?.aborted) noteLost();
      throw error;
    }
    // Pages of one token share what it may ask.
    if (reply.status !== 429 || init.signal?.aborted) break;
    await pause(1000 * Math.max(1, Number(reply.headers.get("Retry-After"))), init.signal ?? undefined);
  }
  if (connection.get() === "lost") void probe();
  if (reply.ok || reply.status === 304) return reply;
  const problem = await problemOf(reply);
  if (reply.status === 401 && used === token.get()) signOut();
  throw new Refused(problem);
}

export async function getJson<T>(path: string, signal?: AbortSignal): Promise<T> {
  return (await (await send(path, signal ? { signal } : {})).json()) as T;
}

/** `text`: a body that is JSON already. */
export async function sendJson<T>(method: string, path: string, body?: unknown, headers: Record<string, string> = {}): Promise<T> {
  const text = typeof body === "string" ? body : body === undefined ? "" : JSON.stringify(body);
  const all = text === "" ? headers : { "Content-Type": "application/json", ...headers };
  const reply = await send(path, text === "" ? { method, headers: all } : { method, body: text, headers: all });
  return (reply.status === 204 ? undefined : await reply.json()) as T;
}

export const explain = (error: unknown): string =>
  error instanceof Refused ? error.message : error instanceof TypeError ? "The coordinator does not answer." : String(error);
