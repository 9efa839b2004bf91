import { useMemo, useState } from "preact/hooks";

import { ago, compact, dateTime, duration, percent, whole } from "../format.ts";
import { useClock, usePolled } from "../hooks.ts";
import { hasEnded, type Job, progressOf } from "../model.ts";
import { Empty, Notice, PageTitle, Progress, StateBadge } from "../parts/basics.tsx";
import { Thumbnail } from "../parts/thumbnail.tsx";

const kAtOnce = 50;
type Filter = "all" | "active" | "done" | "problems";
const kFilters: { value: Filter; label: string; takes: (job: Job) => boolean }[] = [
  { value: "all", label: "All", takes: () => true },
  { value: "active", label: "Active", takes: (job) => !hasEnded(job.state) },
  { value: "done", label: "Done", takes: (job) => job.state === "done" },
  { value: "problems", label: "Failed or cancelled", takes: (job) => job.state === "failed" || job.state === "cancelled" },
];

function Row({ job, now }: { job: Job; now: number }) {
  const still = hasEnded(job.state) || job.state === "paused" || job.rays_per_second === 0;
  const idle = hasEnded(job.state) || job.workers === 0;
  const share = progressOf(job);
  const passes = job.passes_wanted > 0 ? `${whole(job.passes_done)} of ${whole(job.passes_wanted)}` : whole(job.passes_done);
  return (
    <tr data-job={job.id} data-state={job.state}>
      <th scope="row">
        <div class="job-cell">
          <Thumbnail job={job} />
          <div>
            <a class="strong row-link" href={`#/jobs/${job.id}`}>
              {job.name}
            </a>
            <span class="sub">{job.id}</span>
          </div>
        </div>
      </th>
      <td data-label="State">
        <StateBadge state={job.state} />
        {job.message !== "" && <span class="sub clip" title={job.message}>{job.message}</span>}
      </td>
      <td data-label="Progress" class="progress-cell">
        <Progress job={job} label={`Progress of ${job.name}`} />
        <span class="sub">
          {passes} sub-passes{share !== null && !hasEnded(job.state) ? ` · ${percent(share)}` : ""}
        </span>
      </td>
      <td data-label="Rate" class={still ? "number blank" : "number"}>{still ? "–" : `${compact(job.rays_per_second)} rays/s`}</td>
      <td data-label="Workers" class={idle ? "number blank" : "number"}>{idle ? "–" : job.workers}</td>
      <td data-label="Time" class={job.seconds === 0 ? "number blank" : "number"}>
        {job.seconds === 0 ? "–" : duration(job.seconds)}
        {!hasEnded(job.state) && job.seconds_left !== null && <span class="sub">{duration(job.seconds_left)} left</span>}
      </td>
      <td data-label="Submitted" class="number" title={dateTime(job.submitted_unix_ms)}>
        {ago(job.submitted_unix_ms, now)}
      </td>
    </tr>
  );
}

function Table({ jobs }: { jobs: Job[] }) {
  const now = useClock(10);
  return (
    <div class="table-frame">
      <table class="list jobs">
        <caption class="unseen">Jobs, the latest first</caption>
        <thead>
          <tr>
            <th scope="col">Job</th>
            <th scope="col">State</th>
            <th scope="col">Progress</th>
            <th scope="col" class="number">Rate</th>
            <th scope="col" class="number">Workers</th>
            <th scope="col" class="number">Time</th>
            <th scope="col" class="number">Submitted</th>
          </tr>
        </thead>
        <tbody>
          {jobs.map((job) => (
            <Row key={job.id} job={job} now={now} />
          ))}
        </tbody>
      </table>
    </div>
  );
}

export function JobsPage() {
  const polled = usePolled<{ jobs: Job[] }>("/v1/jobs", 1.5);
  const [filter, setFilter] = useState<Filter>("all");
  const [text, setText] = useState("");
  const [most, setMost] = useState(kAtOnce);
  const all = useMemo(() => [...(polled.value?.jobs ?? [])].reverse(), [polled.value]);
  const named = all.filter((job) => `${job.name} ${job.id}`.toLowerCase().includes(text.trim().toLowerCase()));
  const takes = kFilters.find((f) => f.value === filter)?.takes ?? (() => true);
  const jobs = named.filter(takes);
  return (
    <>
      <PageTitle text="Jobs">
        <a class="button primary" href="#/submit">
          Submit a job
        </a>
      </PageTitle>
      {polled.error !== "" && (
        <Notice tone="bad" live>
          {polled.error}
        </Notice>
      )}
      {polled.value === undefined ? (
        <p class="loading">Loading…</p>
      ) : all.length === 0 ? (
        <Empty title="No jobs yet">
          <p>
            <a href="#/submit">Submit one here</a>, or on the command line: <code>photonfarm submit jobs/glass-caustic.toml --wait</code>
          </p>
        </Empty>
      ) : (
        <>
          <div class="filters" role="search">
            <div class="segments" role="group" aria-label="Filter by state">
              {kFilters.map(({ value, label, takes: t }) => (
                <button key={value} type="button" aria-pressed={filter === value} onClick={() => setFilter(value)}>
                  {label} <span class="count">{named.filter(t).length}</span>
                </button>
              ))}
            </div>
            <label class="search">
              <span class="unseen">Search by name</span>
              <input type="search" placeholder="Search by name" value={text} onInput={(e) => setText(e.currentTarget.value)} />
            </label>
          </div>
          {jobs.length === 0 ? <Empty title="No job fits the filter" /> : <Table jobs={jobs.slice(0, most)} />}
          {jobs.length > most && (
            <p class="more">
              <button type="button" onClick={() => setMost(most + kAtOnce)}>
                Show more ({jobs.length - most} left)
              </button>
            </p>
          )}
        </>
      )}
    </>
  );
}
