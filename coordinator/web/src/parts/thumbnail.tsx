// A job's image, small, fetched again only when it has visibly changed.
import { useEffect, useRef } from "preact/hooks";

import { fetchPixels } from "../pixels.ts";
import { hasEnded, type Job } from "../model.ts";
import { drawTone, toneTable } from "../tone.ts";

const kWidth = 128;
/** A thumbnail hides most noise: every doubling of the sub-passes is enough. */
const kGrowth = 2;
let table: Uint8ClampedArray | undefined;

export function Thumbnail({ job }: { job: Job }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const shown = useRef(0);
  const finished = useRef(false);
  const due = job.passes_done > 0 && (job.passes_done >= kGrowth * shown.current || (hasEnded(job.state) && !finished.current));
  useEffect(() => {
    if (!due) return;
    const stop = new AbortController();
    fetchPixels(job.id, "beauty", kWidth, stop.signal)
      .then(({ pixels }) => {
        const context = canvas.current?.getContext("2d");
        if (!context || stop.signal.aborted) return;
        shown.current = pixels.passes;
        finished.current = hasEnded(job.state);
        context.canvas.width = pixels.width;
        context.canvas.height = pixels.height;
        const image = context.createImageData(pixels.width, pixels.height);
        table ??= toneTable(0, "clamp");
        drawTone(pixels, table, image.data);
        context.putImageData(image, 0, 0);
      })
      .catch(() => {
        // No image: the frame stays empty.
      });
    return () => stop.abort();
  }, [due, job.id]);
  return <canvas class="thumbnail" ref={canvas} aria-hidden="true" width={4} height={3} />;
}
