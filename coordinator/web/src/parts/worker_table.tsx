// Workers and what they do, on their own page and on a job's.
import type { ComponentChildren } from "preact";
import { useMemo } from "preact/hooks";

import { compact } from "../format.ts";
import { useRates } from "../hooks.ts";
import type { Worker } from "../model.ts";
import { StateBadge } from "./basics.tsx";

const heard = (seconds: number | null): string => (seconds === null ? "–" : seconds < 2 ? "now" : `${Math.round(seconds)} s ago`);

export function WorkerTable({ workers, caption, withJob, actions }: { workers: Worker[]; caption: string; withJob: boolean; actions?: (worker: Worker) => ComponentChildren }) {
  const rates = useRates(useMemo(() => workers.map((w) => ({ name: w.name, value: w.rays })), [workers]));
  const rate = (worker: Worker): string => {
    const value = rates.get(worker.name);
    return value === undefined || value === null ? "–" : `${compact(value)}/s`;
  };
  return (
    <table class="list workers">
      <caption class="unseen">{caption}</caption>
      <thead>
        <tr>
          <th scope="col">Worker</th>
          <th scope="col">State</th>
          {withJob && <th scope="col">Job</th>}
          <th scope="col" class="number">Units</th>
          <th scope="col" class="number">Rays</th>
          <th scope="col" class="number">Sub-passes</th>
          <th scope="col" class="number">Heard</th>
          {actions !== undefined && (
            <th scope="col">
              <span class="unseen">Actions</span>
            </th>
          )}
        </tr>
      </thead>
      <tbody>
        {workers.map((w) => (
          <tr key={w.name}>
            <th scope="row">
              <span class="strong">{w.name}</span>
              <span class="sub">{`${w.host}, process ${w.process}`}</span>
            </th>
            <td data-label="State">
              <StateBadge state={w.state} />
              {w.message !== "" && <span class="sub">{w.message}</span>}
            </td>
            {withJob && (
              <td data-label="Job">{w.job_id === "" ? <span class="quiet">–</span> : <a href={`#/jobs/${w.job_id}`}>{w.job_id}</a>}</td>
            )}
            <td data-label="Units" class="number">{w.units_held}</td>
            <td data-label="Rays" class="number">{rate(w)}</td>
            <td data-label="Sub-passes" class="number">{compact(w.sub_passes)}</td>
            <td data-label="Heard" class="number">{heard(w.seconds_since_heard)}</td>
            {actions !== undefined && <td class="row-actions">{actions(w)}</td>}
          </tr>
        ))}
      </tbody>
    </table>
  );
}
