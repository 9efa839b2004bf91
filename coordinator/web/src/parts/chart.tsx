// The estimated error against time or sub-passes, both logarithmic: progressive photon mapping is a straight line there.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import uPlot from "uplot";

import { chosen, compact, duration, figure, whole } from "../format.ts";
import { usePolled } from "../hooks.ts";
import { type ConvergencePoint, isActive, type Job } from "../model.ts";
import { Empty, Panel } from "./basics.tsx";

type Against = "seconds" | "passes";
const kHeight = 260;
const kRowsOfTable = 12;

const colour = (name: string): string => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Grows when light and dark change places. */
function useScheme(): number {
  const [count, setCount] = useState(0);
  useEffect(() => {
    const query = matchMedia("(prefers-color-scheme: dark)");
    const changed = (): void => setCount((n) => n + 1);
    query.addEventListener("change", changed);
    return () => query.removeEventListener("change", changed);
  }, []);
  return count;
}

/** Powers of ten as they are. */
const axisNumber = (v: number): string => (v < 1 ? String(Number(v.toPrecision(1))) : v < 10_000 ? whole(v) : compact(v));

function optionsOf(width: number, against: Against, target: number): uPlot.Options {
  const font = "12px system-ui, sans-serif";
  const axis = { stroke: colour("--text-2"), font, ticks: { stroke: colour("--line"), width: 1 }, grid: { stroke: colour("--line"), width: 1 } };
  const line = colour("--accent");
  return {
    width,
    height: kHeight,
    cursor: { drag: { x: false, y: false } },
    scales: { x: { time: false, distr: 3 }, y: { distr: 3 } },
    legend: { live: true, markers: { show: false } },
    series: [
      { label: against === "seconds" ? "Time" : "Sub-passes", value: (_, v) => (v === null ? "–" : against === "seconds" ? duration(v) : whole(v)) },
      {
        label: "Estimated error",
        stroke: line,
        width: 2,
        points: { show: true, size: 5, stroke: line, fill: colour("--surface") },
        value: (_, v) => (v === null ? "–" : figure(v)),
      },
      ...(target > 0 ? [{ label: "Target", stroke: colour("--good"), width: 1.5, dash: [6, 4], points: { show: false }, value: () => chosen(target) }] : []),
    ],
    axes: [
      { ...axis, values: (_, splits) => splits.map((v) => (v === null ? "" : against === "seconds" ? `${axisNumber(v)} s` : axisNumber(v))), space: 56 },
      { ...axis, values: (_, splits) => splits.map((v) => (v === null ? "" : figure(v).replace(/\.?0+$/, ""))), size: 62, space: 34 },
    ],
  };
}

function Plot({ points, against, target }: { points: ConvergencePoint[]; against: Against; target: number }) {
  const holder = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const scheme = useScheme();
  const data = useMemo((): uPlot.AlignedData => {
    const x = points.map((p) => p[against]);
    const y = points.map((p) => p.estimated_error);
    return target > 0 ? [x, y, x.map(() => target)] : [x, y];
  }, [points, against, target]);
  const latest = useRef(data);
  latest.current = data;
  useEffect(() => {
    const element = holder.current;
    if (element === null) return;
    const made = new uPlot(optionsOf(element.clientWidth, against, target), latest.current, element);
    plot.current = made;
    const resized = new ResizeObserver(() => made.setSize({ width: element.clientWidth, height: kHeight }));
    resized.observe(element);
    return () => {
      resized.disconnect();
      made.destroy();
      plot.current = null;
    };
  }, [against, target, scheme]);
  useEffect(() => plot.current?.setData(data), [data]);
  return <div class="plot" ref={holder} aria-hidden="true" />;
}

function PointsTable({ points }: { points: ConvergencePoint[] }) {
  const step = Math.max(1, Math.ceil(points.length / kRowsOfTable));
  const some = points.filter((_, i) => i % step === 0 || i === points.length - 1);
  return (
    <details class="points">
      <summary>As a table</summary>
      <table>
        <thead>
          <tr>
            <th scope="col">Time</th>
            <th scope="col" class="number">Sub-passes</th>
            <th scope="col" class="number">Rays</th>
            <th scope="col" class="number">Error</th>
          </tr>
        </thead>
        <tbody>
          {some.map((p) => (
            <tr key={p.passes}>
              <td>{duration(p.seconds)}</td>
              <td class="number">{whole(p.passes)}</td>
              <td class="number">{compact(p.rays)}</td>
              <td class="number">{p.estimated_error === null ? "–" : figure(p.estimated_error)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </details>
  );
}

export function ConvergenceChart({ job }: { job: Job }) {
  const [against, setAgainst] = useState<Against>("seconds");
  const polled = usePolled<{ points: ConvergencePoint[] }>(`/v1/jobs/${job.id}/convergence`, isActive(job.state) ? 5 : 20);
  // A logarithm needs more than nothing.
  const points = useMemo(
    () => (polled.value?.points ?? []).filter((p) => p.estimated_error !== null && p.estimated_error > 0 && p[against] > 0),
    [polled.value, against],
  );
  const last = points.at(-1);
  const choice = (
    <div class="segments" role="group" aria-label="Horizontal axis">
      {(["seconds", "passes"] as const).map((a) => (
        <button key={a} type="button" aria-pressed={against === a} onClick={() => setAgainst(a)}>
          {a === "seconds" ? "Time" : "Sub-passes"}
        </button>
      ))}
    </div>
  );
  return (
    <Panel title="Convergence" aside={choice} class="chart-panel">
      {polled.value === undefined && polled.error === "" ? (
        <p class="loading">Loading…</p>
      ) : points.length < 2 ? (
        <Empty title={isActive(job.state) ? "No line yet" : "No error was estimated"}>
          <p>The estimated error is drawn once the job has a few figures of it.</p>
        </Empty>
      ) : (
        <figure>
          <Plot points={points} against={against} target={job.stop_error} />
          <figcaption>
            Estimated relative error {last ? `${figure(last.estimated_error ?? 0)} after ${whole(last.passes)} sub-passes` : ""}; both axes
            logarithmic{job.stop_error > 0 ? `, dashed the target ${chosen(job.stop_error)}` : ""}.
          </figcaption>
          <PointsTable points={points} />
        </figure>
      )}
    </Panel>
  );
}
