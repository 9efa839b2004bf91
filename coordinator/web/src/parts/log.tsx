// The tail of a job's log, read in steps: a stream of its own would hold one of the browser's six connections.
import { useEffect, useRef, useState } from "preact/hooks";

import { pause, send, whenUp } from "../api.ts";
import { clockTime } from "../format.ts";
import { isActive, type Job, type LogEntry } from "../model.ts";
import { Empty, Panel } from "./basics.tsx";

const kMaxShown = 500;

async function entriesAfter(id: string, after: number, signal: AbortSignal): Promise<LogEntry[]> {
  const reply = await send(`/v1/jobs/${id}/logs?after=${after}`, { signal });
  const lines = (await reply.text()).split("\n");
  return lines.filter((line) => line !== "").map((line) => JSON.parse(line) as LogEntry);
}

function useLog(job: Job): LogEntry[] {
  const [entries, setEntries] = useState<LogEntry[]>([]);
  const latest = useRef(job);
  latest.current = job;
  useEffect(() => {
    setEntries([]);
    const stop = new AbortController();
    void (async () => {
      let after = 0;
      while (!stop.signal.aborted) {
        await whenUp(stop.signal);
        try {
          const more = document.visibilityState === "visible" ? await entriesAfter(job.id, after, stop.signal) : [];
          if (stop.signal.aborted) return;
          after = more.at(-1)?.number ?? after;
          if (more.length > 0) setEntries((have) => [...have, ...more].slice(-kMaxShown));
        } catch {
          // `send` has noted why.
        }
        await pause(isActive(latest.current.state) ? 3000 : 6000, stop.signal);
      }
    })();
    return () => stop.abort();
  }, [job.id]);
  return entries;
}

export function LogTail({ job }: { job: Job }) {
  const entries = useLog(job);
  const [follow, setFollow] = useState(true);
  const [problems, setProblems] = useState(false);
  const list = useRef<HTMLOListElement>(null);
  const shown = problems ? entries.filter((e) => e.level !== "info" && e.level !== "debug") : entries;
  useEffect(() => {
    if (follow && list.current !== null) list.current.scrollTop = list.current.scrollHeight;
  }, [shown.length, follow]);
  const aside = (
    <div class="toggles">
      <label class="check">
        <input type="checkbox" checked={problems} onChange={(e) => setProblems(e.currentTarget.checked)} /> Problems only
      </label>
      <label class="check">
        <input type="checkbox" checked={follow} onChange={(e) => setFollow(e.currentTarget.checked)} /> Follow
      </label>
    </div>
  );
  return (
    <Panel title="Log" aside={aside} class="log-panel">
      {shown.length === 0 ? (
        <Empty title={problems && entries.length > 0 ? "No problems so far" : "Nothing logged yet"} />
      ) : (
        <ol class="log" ref={list} tabIndex={0} aria-label="Log entries">
          {shown.map((e) => (
            <li key={e.number} class={`level-${e.level}`}>
              <time dateTime={new Date(e.unix_ms).toISOString()}>{clockTime(e.unix_ms)}</time>
              <span class="level">{e.level}</span>
              <span class="source">{e.source}</span>
              <span class="text">{e.text}</span>
            </li>
          ))}
        </ol>
      )}
    </Panel>
  );
}
