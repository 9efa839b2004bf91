// A job's files. A link could not carry the token, so that they are fetched and handed to the browser.
import { useState } from "preact/hooks";

import { explain, send } from "../api.ts";
import { type Job, whyNoImage } from "../model.ts";
import { Notice } from "./basics.tsx";

interface Item {
  label: string;
  path: string;
  extension: string;
}

const kCheckpoint: Item = { label: "Checkpoint", path: "checkpoint", extension: "checkpoint" };
const kItems: Item[] = [
  { label: "EXR, all layers", path: "image.exr", extension: "exr" },
  { label: "PNG", path: "image.png", extension: "png" },
  { label: "Figures", path: "figures.json", extension: "json" },
  kCheckpoint,
];
const kPreview: Item = { label: "PNG so far", path: "preview.png", extension: "png" };

export function Downloads({ job }: { job: Job }) {
  const [problem, setProblem] = useState("");
  const [busy, setBusy] = useState("");
  const finished = job.state === "done" || job.state === "cancelled";
  const kept = kItems.filter((item) => item !== kCheckpoint || !job.expired.includes("checkpoint"));
  const items = whyNoImage(job) !== "" || job.passes_done === 0 ? [] : finished ? kept : [kPreview];
  const fetchFile = (item: Item): void => {
    setBusy(item.path);
    setProblem("");
    send(`/v1/jobs/${job.id}/${item.path}`)
      .then((reply) => reply.blob())
      .then((blob) => {
        const link = document.createElement("a");
        link.href = URL.createObjectURL(blob);
        link.download = `${job.name}.${item.extension}`;
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
      })
      .catch((error: unknown) => setProblem(explain(error)))
      .finally(() => setBusy(""));
  };
  if (items.length === 0) return null;
  return (
    <div class="downloads">
      <h2 class="minor">Download</h2>
      <div class="actions" role="group" aria-label="Downloads">
        {items.map((item) => (
          <button key={item.path} type="button" class="small" disabled={busy !== ""} onClick={() => fetchFile(item)}>
            {busy === item.path ? "Fetching…" : item.label}
          </button>
        ))}
      </div>
      {problem !== "" && (
        <Notice tone="bad" live>
          {problem}
        </Notice>
      )}
    </div>
  );
}
