// The image while it converges.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";

import { figure, whole } from "../format.ts";
import { halfValues } from "../halves.ts";
import { usePolled } from "../hooks.ts";
import { type Look, looksOf } from "../looks.ts";
import { type Job, type Layers, whyNoImage } from "../model.ts";
import { useLiveLayers } from "../pixels.ts";
import * as tone from "../tone.ts";
import { Notice } from "./basics.tsx";

const kMaxWidth = 1280;
const kExposures = 8; // stops to either side

interface Drawn {
  look?: Look;
  passes?: number;
  range?: tone.Range;
  values?: Float32Array;
}

function draw(canvas: HTMLCanvasElement, layers: tone.Pixels[], look: Look, table: Uint8ClampedArray): Drawn {
  const first = layers[0];
  const context = canvas.getContext("2d");
  if (first === undefined || context === null) return {};
  if (canvas.width !== first.width || canvas.height !== first.height) {
    canvas.width = first.width;
    canvas.height = first.height;
  }
  const image = context.createImageData(first.width, first.height);
  const drawn: Drawn = { look, passes: first.passes };
  if (look.kind === "colour") {
    tone.drawTone(first, table, image.data);
  } else if (look.kind === "normal") {
    tone.drawNormal(first, image.data);
  } else {
    const beauty = layers[1] ?? first;
    drawn.values = look.kind === "error" ? tone.relativeError(first, beauty) : tone.channelOf(first, look.channel);
    drawn.range = tone.rangeOf(drawn.values, look.logarithmic);
    tone.drawScale(drawn.values, drawn.range, look.scale, image.data);
  }
  context.putImageData(image, 0, 0);
  return drawn;
}

function Legend({ look, range }: { look: Look; range: tone.Range }) {
  const name = (v: number): string => (look.kind === "error" ? `${figure(100 * v)} %` : `${figure(v)}${look.unit}`);
  const middle = range.logarithmic ? Math.sqrt(range.low * range.high) : (range.low + range.high) / 2;
  const title = look.kind === "error" ? "Estimated relative error" : look.label;
  return (
    <div class="legend" role="img" aria-label={`${title}: colours from ${name(range.low)}, dark, to ${name(range.high)}, bright`}>
      <span class="legend-title">{title}</span>
      <span class="legend-bar" style={{ background: tone.gradientOf(look.scale) }} />
      <span class="legend-ticks">
        <span>{name(range.low)}</span>
        <span>{name(middle)}</span>
        <span>{name(range.high)}</span>
      </span>
    </div>
  );
}

/** What lies under the pointer. */
function probeText(x: number, y: number, layers: tone.Pixels[], look: Look, drawn: Drawn): string {
  const first = layers[0];
  if (first === undefined || x < 0 || y < 0 || x >= first.width || y >= first.height) return "";
  const at = y * first.width + x;
  if (drawn.values !== undefined) {
    const v = drawn.values[at] ?? NaN;
    return `${x}, ${y}: ${look.kind === "error" ? `${figure(100 * v)} %` : figure(v) + look.unit}`;
  }
  const rgb = [0, 1, 2].map((c) => figure(halfValues[first.rgb[3 * at + c] ?? 0] ?? 0));
  return `${x}, ${y}: ${rgb.join("  ")}`;
}

function Controls(props: {
  looks: Look[];
  look: Look | undefined;
  setLook: (key: string) => void;
  exposure: number;
  setExposure: (stops: number) => void;
  curve: tone.Curve;
  setCurve: (curve: tone.Curve) => void;
  actualSize: boolean;
  setActualSize: (on: boolean) => void;
}) {
  const { looks, look, exposure } = props;
  const toned = look?.kind === "colour";
  return (
    <div class="viewer-controls">
      <label>
        <span>Layer</span>
        <select value={look?.key} onChange={(e) => props.setLook(e.currentTarget.value)} disabled={looks.length === 0}>
          {looks.map((l) => (
            <option key={l.key} value={l.key}>
              {l.label}
            </option>
          ))}
        </select>
      </label>
      <label class="exposure">
        <span>Exposure</span>
        <input
          type="range"
          min={-kExposures}
          max={kExposures}
          step={0.1}
          value={exposure}
          disabled={!toned}
          aria-valuetext={`${exposure.toFixed(1)} stops`}
          onInput={(e) => props.setExposure(Number(e.currentTarget.value))}
          onDblClick={() => props.setExposure(0)}
        />
        <output>{`${exposure >= 0 ? "+" : "−"}${Math.abs(exposure).toFixed(1)}`}</output>
      </label>
      <label>
        <span>Tone</span>
        <select value={props.curve} disabled={!toned} onChange={(e) => props.setCurve(e.currentTarget.value as tone.Curve)}>
          {tone.kCurves.map((c) => (
            <option key={c.value} value={c.value}>
              {c.label}
            </option>
          ))}
        </select>
      </label>
      <button type="button" class="small" aria-pressed={props.actualSize} onClick={() => props.setActualSize(!props.actualSize)}>
        Actual size
      </button>
    </div>
  );
}

/** What layers there are: known once there is an image. */
function useLooks(job: Job): Look[] {
  const there = job.passes_done > 0;
  const layers = usePolled<Layers>(there ? `/v1/jobs/${job.id}/layers` : "", 3600);
  return useMemo(() => (layers.value ? looksOf(layers.value) : []), [layers.value]);
}

export function Viewer({ job }: { job: Job }) {
  const looks = useLooks(job);
  const [key, setKey] = useState("beauty");
  const [exposure, setExposure] = useState(0);
  const [curve, setCurve] = useState<tone.Curve>("clamp");
  const [actualSize, setActualSize] = useState(false);
  const [probe, setProbe] = useState("");
  const [drawn, setDrawn] = useState<Drawn>({});
  const canvas = useRef<HTMLCanvasElement>(null);
  const look = looks.find((l) => l.key === key) ?? looks[0];
  const { names, layers, error } = useLiveLayers(job, look?.layers ?? [], Math.min(kMaxWidth, job.width || kMaxWidth));
  const table = useMemo(() => tone.toneTable(exposure, curve), [exposure, curve]);
  useEffect(() => {
    if (canvas.current !== null && look !== undefined && names.join() === look.layers.join()) {
      setDrawn(draw(canvas.current, layers, look, table));
    }
  }, [names, layers, look, table]);
  const { passes } = drawn;
  const shape = { aspectRatio: `${job.width || 4} / ${job.height || 3}` };
  const description = passes === undefined ? "No image yet" : `${drawn.look?.label ?? ""} of ${job.name} after ${whole(passes)} sub-passes`;
  return (
    <section class="viewer" aria-label="Image">
      <div class={`stage${actualSize ? " actual" : ""}`} tabIndex={actualSize ? 0 : -1}>
        <canvas
          ref={canvas}
          role="img"
          aria-label={description}
          data-passes={passes ?? 0}
          data-look={drawn.look?.key ?? ""}
          hidden={passes === undefined}
          width={job.width || 4}
          height={job.height || 3}
          onPointerLeave={() => setProbe("")}
          onPointerMove={(e) => {
            const box = e.currentTarget.getBoundingClientRect();
            const x = Math.floor(((e.clientX - box.left) / box.width) * e.currentTarget.width);
            const y = Math.floor(((e.clientY - box.top) / box.height) * e.currentTarget.height);
            if (drawn.look !== undefined) setProbe(probeText(x, y, layers, drawn.look, drawn));
          }}
        />
        {passes === undefined && (
          <p class="stage-empty" style={shape}>
            {whyNoImage(job) || error || (job.passes_done > 0 ? "Loading the image…" : "The image appears with the first sub-pass.")}
          </p>
        )}
      </div>
      {drawn.look !== undefined && drawn.range !== undefined && <Legend look={drawn.look} range={drawn.range} />}
      <Controls {...{ looks, look, exposure, setExposure, curve, setCurve, actualSize, setActualSize }} setLook={setKey} />
      <p class="stage-note">
        <span>
          {passes !== undefined && `${whole(passes)} sub-passes shown`}
          {looks.length > 0 && !looks.some((l) => l.kind === "error") && " · no error map: integrator.error_estimate is off"}
        </span>
        <span class="probe" aria-hidden="true">
          {probe}
        </span>
      </p>
      {error !== "" && passes !== undefined && <Notice tone="held">{error}</Notice>}
    </section>
  );
}
