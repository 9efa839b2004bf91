import { useState } from "preact/hooks";

import { explain, sendJson } from "../api.ts";
import { usePolled } from "../hooks.ts";
import type { Worker } from "../model.ts";
import { Empty, Notice, PageTitle } from "../parts/basics.tsx";
import { WorkerTable } from "../parts/worker_table.tsx";

type Verb = "drain" | "disable" | "enable";
const kLabels: Record<Verb, string> = { drain: "Drain", disable: "Disable", enable: "Enable" };
const kWhat: Record<Verb, string> = {
  drain: "finishes the units it holds and takes no more",
  disable: "gives its units back and takes no more",
  enable: "takes units again",
};

function verbsOf(worker: Worker): Verb[] {
  if (worker.state === "lost") return [];
  if (["disabled", "drained", "quarantined"].includes(worker.state)) return ["enable"];
  if (worker.state === "draining") return ["enable", "disable"];
  return ["drain", "disable"];
}

export function WorkersPage() {
  const polled = usePolled<{ workers: Worker[] }>("/v1/workers", 1.5);
  const [problem, setProblem] = useState("");
  const [said, setSaid] = useState("");
  const act = (worker: Worker, verb: Verb): void => {
    setProblem("");
    sendJson<Worker>("POST", `/v1/workers/${encodeURIComponent(worker.name)}/${verb}`)
      .then(() => {
        setSaid(`${worker.name} ${kWhat[verb]}.`);
        polled.refresh();
      })
      .catch((error: unknown) => setProblem(explain(error)));
  };
  const workers = polled.value?.workers;
  const live = workers?.filter((w) => w.state !== "lost").length ?? 0;
  return (
    <>
      <PageTitle text="Workers">
        {workers !== undefined && workers.length > 0 && <p class="lead">{`${live} of ${workers.length} there`}</p>}
      </PageTitle>
      <p class="unseen" role="status">
        {said}
      </p>
      {(problem !== "" || polled.error !== "") && (
        <Notice tone="bad" live>
          {problem !== "" ? problem : polled.error}
        </Notice>
      )}
      {workers === undefined ? (
        <p class="loading">Loading…</p>
      ) : workers.length === 0 ? (
        <Empty title="No workers">
          <p>
            Start some on any machine that reaches the farm: <code>photonfarm-worker</code>, or here <code>photonfarm farm --workers 4</code>.
          </p>
        </Empty>
      ) : (
        <div class="table-frame">
          <WorkerTable
            workers={workers}
            caption="Workers of the farm"
            withJob
            actions={(worker) =>
              verbsOf(worker).map((verb) => (
                <button key={verb} type="button" class="small" title={`The worker ${kWhat[verb]}`} aria-label={`${kLabels[verb]} ${worker.name}`} onClick={() => act(worker, verb)}>
                  {kLabels[verb]}
                </button>
              ))
            }
          />
        </div>
      )}
    </>
  );
}
