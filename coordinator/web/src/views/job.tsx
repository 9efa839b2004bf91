import type { ComponentChildren } from "preact";
import { useMemo } from "preact/hooks";

import { bytes, chosen, compact, dateTime, duration, figure, percent, whole } from "../format.ts";
import { useJob, usePolled } from "../hooks.ts";
import { hasEnded, type Job, progressOf, type Worker } from "../model.ts";
import { Actions } from "../parts/actions.tsx";
import { Empty, Notice, PageTitle, Panel, Progress, StateBadge } from "../parts/basics.tsx";
import { ConvergenceChart } from "../parts/chart.tsx";
import { Downloads } from "../parts/downloads.tsx";
import { LogTail } from "../parts/log.tsx";
import { Viewer } from "../parts/viewer.tsx";
import { WorkerTable } from "../parts/worker_table.tsx";

function Fact({ name, children, note }: { name: string; children: ComponentChildren; note?: string }) {
  return (
    <div>
      <dt>{name}</dt>
      <dd>
        {children}
        {note !== undefined && note !== "" && <span class="sub">{note}</span>}
      </dd>
    </div>
  );
}

function Status({ job }: { job: Job }) {
  const share = progressOf(job);
  const stops = [
    job.passes_wanted > 0 ? `${whole(job.passes_wanted)} sub-passes` : "",
    job.stop_seconds > 0 ? duration(job.stop_seconds) : "",
    job.stop_error > 0 ? `error ${chosen(job.stop_error)}` : "",
  ].filter((s) => s !== "");
  const live = !hasEnded(job.state) && job.state !== "paused";
  return (
    <div class="status">
      <div class="status-head">
        <span class="status-state" role="status" data-state={job.state}>
          <span class="unseen">State: </span>
          <StateBadge state={job.state} />
        </span>
        <span class="status-share">{share === null ? "" : percent(share)}</span>
      </div>
      <Progress job={job} label="Progress" />
      <p class="sub">
        {stops.length > 0 ? `Stops at ${stops.join(" or ")}` : "No bound"}
        {live && job.seconds_left !== null ? ` · about ${duration(job.seconds_left)} left` : ""}
      </p>
      {job.message !== "" && <Notice tone={job.state === "failed" ? "bad" : "held"}>{job.message}</Notice>}
      <dl class="facts">
        <Fact name="Sub-passes" note={`${whole(job.rounds)} rounds`}>
          <span data-fact="passes">{whole(job.passes_done)}</span>
        </Fact>
        <Fact name="Estimated error">{job.estimated_error === null ? "–" : figure(job.estimated_error)}</Fact>
        <Fact name="Time">{duration(job.seconds)}</Fact>
        <Fact name="Workers" note={job.max_workers ? `at most ${job.max_workers}` : ""}>
          {job.workers}
        </Fact>
        <Fact name="Rays" note={live ? `${compact(job.rays_per_second)}/s` : ""}>
          {compact(job.rays)}
        </Fact>
        <Fact name="Photon paths" note={live ? `${job.passes_per_second.toPrecision(2)} sub-passes/s` : ""}>
          {compact(job.photon_paths)}
        </Fact>
      </dl>
    </div>
  );
}

function Details({ job }: { job: Job }) {
  const hash = (text: string): ComponentChildren => (text === "" ? "–" : <code title={text}>{text.slice(0, 16)}</code>);
  return (
    <Panel title="Details" class="details-panel">
      <dl class="facts wide">
        <Fact name="Algorithm">{job.algorithm === "" ? "not decided yet" : job.algorithm}</Fact>
        <Fact name="Image">{job.width > 0 ? `${job.width} × ${job.height}` : "–"}</Fact>
        <Fact name="Priority">{job.priority}</Fact>
        <Fact name="Units done" note={job.units_repeated > 0 ? `${job.units_repeated} repeated` : ""}>
          {whole(job.units_done)}
        </Fact>
        <Fact name="Received">{bytes(job.bytes_received)}</Fact>
        <Fact name="Merging">{duration(job.merge_seconds)}</Fact>
        <Fact name="Submitted" note={job.submitted_by ? `by ${job.submitted_by}` : ""}>
          {dateTime(job.submitted_unix_ms)}
        </Fact>
        <Fact name="Began">{dateTime(job.started_unix_ms)}</Fact>
        <Fact name="Ended">{dateTime(job.ended_unix_ms)}</Fact>
        <Fact name="Image hash">{hash(job.image_hash)}</Fact>
        <Fact name="Scene hash">{hash(job.scene_hash)}</Fact>
        <Fact name="Spec hash">{hash(job.spec_hash)}</Fact>
      </dl>
      {job.warnings.length > 0 && (
        <Notice tone="held">
          <ul class="plain">
            {job.warnings.map((w) => (
              <li key={w}>{w}</li>
            ))}
          </ul>
        </Notice>
      )}
    </Panel>
  );
}

function JobWorkers({ job }: { job: Job }) {
  const polled = usePolled<{ workers: Worker[] }>(hasEnded(job.state) ? "" : "/v1/workers", 4);
  const mine = useMemo(() => (polled.value?.workers ?? []).filter((w) => w.job_id === job.id), [polled.value, job.id]);
  if (hasEnded(job.state)) return null;
  return (
    <Panel title="Workers on this job">
      {mine.length === 0 ? (
        <Empty title={job.state === "paused" ? "Paused: no worker holds units" : "No worker holds its units now"} />
      ) : (
        <WorkerTable workers={mine} caption="Workers on this job" withJob={false} />
      )}
    </Panel>
  );
}

export function JobPage({ id }: { id: string }) {
  const { job, error, put } = useJob(id);
  if (job === undefined) {
    return (
      <>
        <PageTitle text={id} />
        {error === "" ? (
          <p class="loading">Loading…</p>
        ) : (
          <Empty title="This job cannot be shown">
            <p>{error}</p>
            <p>
              <a href="#/">All jobs</a>
            </p>
          </Empty>
        )}
      </>
    );
  }
  return (
    <>
      <nav class="crumbs" aria-label="Breadcrumb">
        <a href="#/">Jobs</a> <span aria-hidden="true">/</span> <span>{job.id}</span>
      </nav>
      <PageTitle text={job.name} />
      <div class="job-page">
        <Viewer job={job} />
        <div class="side">
          <Status job={job} />
          <Actions job={job} put={put} />
          <Downloads job={job} />
        </div>
        <ConvergenceChart job={job} />
        <JobWorkers job={job} />
        <LogTail job={job} />
        <Details job={job} />
      </div>
    </>
  );
}
