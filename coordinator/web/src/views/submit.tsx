import { useEffect, useRef, useState } from "preact/hooks";

import { explain, Refused, sendJson } from "../api.ts";
import { bytes } from "../format.ts";
import type { Job } from "../model.ts";
import { Notice, PageTitle, Panel } from "../parts/basics.tsx";
import { SpecEditor } from "../parts/spec_editor.tsx";
import { filesNeeded, type Needed, newKey, upload } from "../scene_files.ts";
import { isProblem, kExample, lineOf, type ParsedSpec, parseSpec, type Place, withoutPlace } from "../spec_text.ts";

const kTypingPause = 250; // ms

type Check =
  | { state: "checking" }
  | { state: "good"; parsed: ParsedSpec; summary: string; warnings: string[] }
  | { state: "bad"; parsed?: ParsedSpec; message: string; place: Place };

interface Validated {
  valid: boolean;
  spec: { integrator?: { type?: string }; image?: { width?: number; height?: number }; stop?: { passes?: number; seconds?: number; error?: number } };
  warnings: string[];
}

function summaryOf({ spec }: Validated): string {
  const stop = spec.stop ?? {};
  const stops = [stop.passes ? `${stop.passes} sub-passes` : "", stop.seconds ? `${stop.seconds} s` : "", stop.error ? `error ${stop.error}` : ""];
  return [spec.integrator?.type ?? "", `${spec.image?.width ?? "?"} × ${spec.image?.height ?? "?"}`, stops.filter((s) => s !== "").join(" or ")]
    .filter((s) => s !== "")
    .join(", ");
}

async function check(text: string): Promise<Check> {
  const parsed = parseSpec(text);
  if (isProblem(parsed)) return { state: "bad", ...parsed };
  try {
    const answer = await sendJson<Validated>("POST", "/v1/jobs/validate", parsed.body([]));
    return { state: "good", parsed, summary: summaryOf(answer), warnings: answer.warnings };
  } catch (error) {
    const line = error instanceof Refused ? lineOf(error.problem.place) : undefined;
    const place = line === undefined ? { line: 0, column: 0 } : parsed.placeOf(line);
    return { state: "bad", parsed, message: withoutPlace(explain(error)), place };
  }
}

/** Checked a moment after the last key. */
function useCheck(text: string): Check {
  const [result, setResult] = useState<Check>({ state: "checking" });
  useEffect(() => {
    let current = true;
    const timer = setTimeout(() => {
      void check(text).then((next) => {
        if (current) setResult(next);
      });
    }, kTypingPause);
    return () => {
      current = false;
      clearTimeout(timer);
    };
  }, [text]);
  return result;
}

function Verdict({ result }: { result: Check }) {
  return (
    <div class="verdict" role="status" data-verdict={result.state}>
      {result.state === "checking" && <span class="quiet">Checking…</span>}
      {result.state === "good" && (
        <Notice tone="info">
          <strong>Valid</strong> {result.summary}
          {result.warnings.map((w) => (
            <span class="sub" key={w}>{w}</span>
          ))}
        </Notice>
      )}
      {result.state === "bad" && (
        <Notice tone="bad">
          {result.place.line > 0 && <strong>{`Line ${result.place.line}, column ${result.place.column}: `}</strong>}
          {result.message}
        </Notice>
      )}
    </div>
  );
}

function FileList({ needed }: { needed: Needed[] }) {
  if (needed.length === 0) return <p class="quiet">The job file names no scene yet.</p>;
  return (
    <ul class="files">
      {needed.map(({ path, file }) => (
        <li key={path} class={file === undefined ? "missing" : "there"}>
          <code>{path}</code>
          <span>{file === undefined ? "not chosen yet" : `${file.name}, ${bytes(file.size)}`}</span>
        </li>
      ))}
    </ul>
  );
}

function useNeeded(result: Check, chosen: File[]): Needed[] {
  const [needed, setNeeded] = useState<Needed[]>([]);
  const parsed = result.state === "checking" ? undefined : result.parsed;
  useEffect(() => {
    if (parsed === undefined) return;
    let current = true;
    void filesNeeded(parsed.sceneFile, parsed.environment, chosen).then((next) => {
      if (current) setNeeded(next);
    });
    return () => {
      current = false;
    };
  }, [parsed?.sceneFile, parsed?.environment, chosen]);
  return needed;
}

export function SubmitPage() {
  const [text, setText] = useState(kExample);
  const [chosen, setChosen] = useState<File[]>([]);
  const [step, setStep] = useState("");
  const [problem, setProblem] = useState("");
  const key = useRef(newKey());
  const result = useCheck(text);
  const needed = useNeeded(result, chosen);
  const complete = result.state === "good" && needed.length > 0 && needed.every((n) => n.file !== undefined);
  const submit = async (): Promise<void> => {
    if (result.state !== "good") return;
    setProblem("");
    try {
      const files = [];
      for (const { path, file } of needed) {
        if (file === undefined) return;
        setStep(`Uploading ${file.name}…`);
        files.push(await upload(path, file));
      }
      setStep("Submitting…");
      const job = await sendJson<Job>("POST", "/v1/jobs", result.parsed.body(files), { "Idempotency-Key": key.current });
      location.hash = `#/jobs/${job.id}`;
    } catch (error) {
      setProblem(error instanceof Error && !(error instanceof TypeError) ? error.message : explain(error));
      setStep("");
      key.current = newKey();
    }
  };
  return (
    <>
      <PageTitle text="Submit a job" />
      <form
        class="submit-page"
        onSubmit={(e) => {
          e.preventDefault();
          if (complete && step === "") void submit();
        }}
      >
        <Panel
          title="Job file"
          aside={
            <label class="button small">
              Open a TOML file…
              <input
                class="unseen"
                type="file"
                accept=".toml,text/*"
                onChange={(e) => {
                  const file = e.currentTarget.files?.[0];
                  if (file !== undefined) void file.text().then(setText);
                  e.currentTarget.value = "";
                }}
              />
            </label>
          }
        >
          <SpecEditor text={text} setText={setText} badLine={result.state === "bad" ? result.place.line : 0} />
          <Verdict result={result} />
        </Panel>
        <div class="side">
          <Panel title="Scene files">
            <FileList needed={needed} />
            <label class="file-input">
              <span>Choose the scene, its buffers and its textures</span>
              <input
                type="file"
                multiple
                accept=".gltf,.glb,.bin,.png,.jpg,.jpeg,.exr,.hdr,.ktx2,.webp"
                onChange={(e) => setChosen([...chosen, ...(e.currentTarget.files ?? [])])}
              />
            </label>
          </Panel>
          <button type="submit" class="primary big" disabled={!complete || step !== ""}>
            {step === "" ? "Submit" : step}
          </button>
          {result.state === "good" && !complete && needed.length > 0 && <p class="sub">Choose the missing files first.</p>}
          {problem !== "" && (
            <Notice tone="bad" live>
              {problem}
            </Notice>
          )}
        </div>
      </form>
    </>
  );
}
