// What may be done to a job in its present state.
import { useState } from "preact/hooks";

import { explain, send, sendJson } from "../api.ts";
import { hasEnded, type Job } from "../model.ts";
import { Dialog, Notice } from "./basics.tsx";

type Verb = "pause" | "resume" | "cancel" | "extend" | "retry" | "priority" | "remove";

const kInPlay = new Set<string>(["queued", "preparing", "running", "waiting"]);

function verbsOf(job: Job): Verb[] {
  const verbs: Verb[] = [];
  if (kInPlay.has(job.state)) verbs.push("pause");
  if (job.state === "paused") verbs.push("resume");
  if (job.state === "failed" || job.state === "cancelled") verbs.push("retry");
  if (job.state !== "failed" && job.state !== "cancelled" && job.state !== "finishing") verbs.push("extend");
  if (!hasEnded(job.state)) verbs.push("priority", "cancel");
  if (hasEnded(job.state)) verbs.push("remove");
  return verbs;
}

const kLabels: Record<Verb, string> = {
  pause: "Pause",
  resume: "Resume",
  cancel: "Cancel…",
  extend: "Extend…",
  retry: "Retry",
  priority: "Priority…",
  remove: "Delete…",
};
const kPrimary = new Set<Verb>(["resume", "retry"]);

interface Asked {
  job: Job;
  act: (request: () => Promise<Job | undefined>) => void;
  close: () => void;
}

function CancelDialog({ job, act, close }: Asked) {
  const cancel = (discard: boolean): void =>
    act(() => sendJson<Job>("POST", `/v1/jobs/${job.id}/cancel`, discard ? { discard: true } : undefined));
  return (
    <Dialog title={`Cancel ${job.name}?`} onClose={close}>
      <p>The workers turn to other jobs. The image so far can be kept: it can be downloaded, and the job can go on later with Retry.</p>
      <div class="dialog-actions">
        <button type="button" onClick={close} autoFocus>
          Go on rendering
        </button>
        <button type="button" class="danger" onClick={() => cancel(true)}>
          Cancel, discard the image
        </button>
        <button type="button" class="primary" onClick={() => cancel(false)}>
          Cancel, keep the image
        </button>
      </div>
    </Dialog>
  );
}

function RemoveDialog({ job, act, close }: Asked) {
  const remove = (): void =>
    act(async () => {
      await send(`/v1/jobs/${job.id}`, { method: "DELETE" });
      location.hash = "#/";
      return undefined;
    });
  return (
    <Dialog title={`Delete ${job.name}?`} onClose={close}>
      <p>Its image, checkpoint and log are removed for good.</p>
      <div class="dialog-actions">
        <button type="button" onClick={close} autoFocus>
          Keep it
        </button>
        <button type="button" class="danger" onClick={remove}>
          Delete
        </button>
      </div>
    </Dialog>
  );
}

function ExtendDialog({ job, act, close }: Asked) {
  const [passes, setPasses] = useState(job.passes_wanted > 0 ? String(2 * job.passes_wanted) : "");
  const [seconds, setSeconds] = useState(job.stop_seconds > 0 ? String(2 * job.stop_seconds) : "");
  const [error, setError] = useState(job.stop_error > 0 ? String(job.stop_error / 2) : "");
  const extend = (): void => {
    const body: Record<string, number> = {};
    if (passes !== "" && Number(passes) !== job.passes_wanted) body["passes"] = Number(passes);
    if (seconds !== "" && Number(seconds) !== job.stop_seconds) body["seconds"] = Number(seconds);
    if (error !== "" && Number(error) !== job.stop_error) body["error"] = Number(error);
    act(() => sendJson<Job>("POST", `/v1/jobs/${job.id}/extend`, body));
  };
  return (
    <Dialog title={`Extend ${job.name}`} onClose={close}>
      <form
        class="fields"
        onSubmit={(e) => {
          e.preventDefault();
          extend();
        }}
      >
        <p>
          New bounds; whichever comes first ends the job. It goes on from its {job.passes_done} sub-passes to the bits of one long run.
        </p>
        <label>
          <span>Sub-passes</span>
          <input type="number" min={Math.max(1, job.passes_done)} step={1} value={passes} autoFocus onInput={(e) => setPasses(e.currentTarget.value)} />
        </label>
        <label>
          <span>Seconds</span>
          <input type="number" min={0} step="any" value={seconds} placeholder="no bound" onInput={(e) => setSeconds(e.currentTarget.value)} />
        </label>
        <label>
          <span>Estimated error</span>
          <input type="number" min={0} step="any" value={error} placeholder="no bound" onInput={(e) => setError(e.currentTarget.value)} />
        </label>
        <div class="dialog-actions">
          <button type="button" onClick={close}>
            Leave as it is
          </button>
          <button type="submit" class="primary" disabled={passes === "" && seconds === "" && error === ""}>
            Extend
          </button>
        </div>
      </form>
    </Dialog>
  );
}

function PriorityDialog({ job, act, close }: Asked) {
  const [priority, setPriority] = useState(String(job.priority));
  const [workers, setWorkers] = useState(String(job.max_workers ?? 0));
  const change = (): void =>
    act(() => sendJson<Job>("PATCH", `/v1/jobs/${job.id}`, { priority: Number(priority), max_workers: Number(workers) }));
  return (
    <Dialog title={`Priority of ${job.name}`} onClose={close}>
      <form
        class="fields"
        onSubmit={(e) => {
          e.preventDefault();
          change();
        }}
      >
        <p>Ten points more double the job's share of the workers.</p>
        <label>
          <span>Priority, 0 to 100</span>
          <input type="number" min={0} max={100} step={1} required value={priority} autoFocus onInput={(e) => setPriority(e.currentTarget.value)} />
        </label>
        <label>
          <span>Most workers at a time; 0: no bound</span>
          <input type="number" min={0} step={1} required value={workers} onInput={(e) => setWorkers(e.currentTarget.value)} />
        </label>
        <div class="dialog-actions">
          <button type="button" onClick={close}>
            Leave as it is
          </button>
          <button type="submit" class="primary">
            Change
          </button>
        </div>
      </form>
    </Dialog>
  );
}

const kDialogs: Partial<Record<Verb, (asked: Asked) => preact.JSX.Element>> = {
  cancel: CancelDialog,
  extend: ExtendDialog,
  priority: PriorityDialog,
  remove: RemoveDialog,
};

export function Actions({ job, put }: { job: Job; put: (job: Job) => void }) {
  const [asked, setAsked] = useState<Verb | undefined>(undefined);
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState("");
  const act = (request: () => Promise<Job | undefined>): void => {
    setBusy(true);
    setProblem("");
    setAsked(undefined);
    request()
      .then((next) => {
        if (next !== undefined) put(next);
      })
      .catch((error: unknown) => setProblem(explain(error)))
      .finally(() => setBusy(false));
  };
  const choose = (verb: Verb): void => {
    if (verb in kDialogs) setAsked(verb);
    else act(() => sendJson<Job>("POST", `/v1/jobs/${job.id}/${verb}`));
  };
  const Question = asked === undefined ? undefined : kDialogs[asked];
  return (
    <>
      <div class="actions" role="group" aria-label="Actions">
        {verbsOf(job).map((verb) => (
          <button key={verb} type="button" disabled={busy} class={kPrimary.has(verb) ? "primary" : ""} onClick={() => choose(verb)}>
            {kLabels[verb]}
          </button>
        ))}
      </div>
      {problem !== "" && (
        <Notice tone="bad" live>
          {problem}
        </Notice>
      )}
      {Question !== undefined && <Question job={job} act={act} close={() => setAsked(undefined)} />}
    </>
  );
}
