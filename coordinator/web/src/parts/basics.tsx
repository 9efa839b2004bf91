// Small pieces that every page uses.
import type { ComponentChildren, JSX } from "preact";
import { useEffect, useId, useRef } from "preact/hooks";

import { percent } from "../format.ts";
import type { Job, JobState } from "../model.ts";
import { progressOf } from "../model.ts";

/** Shape and colour of a state; its name always stands beside. */
const kStateLook: Record<string, { tone: string; shape: JSX.Element }> = {};
const shapes = {
  ring: <circle cx="6" cy="6" r="4" fill="none" stroke="currentColor" stroke-width="2" />,
  dot: <circle cx="6" cy="6" r="4.5" fill="currentColor" />,
  play: <path d="M3 1.5v9L10.5 6z" fill="currentColor" />,
  bars: <path d="M2.5 2h2.5v8H2.5zM7 2h2.5v8H7z" fill="currentColor" />,
  check: <path d="m1.8 6.4 2.9 2.9 5.5-6.4" fill="none" stroke="currentColor" stroke-width="2" stroke-linecap="round" stroke-linejoin="round" />,
  cross: <path d="m2.5 2.5 7 7m0-7-7 7" stroke="currentColor" stroke-width="2" stroke-linecap="round" />,
  bang: <path d="M6 1 11.4 10.6H.6zM6 4.6v2.6m0 1.5v.6" fill="none" stroke="currentColor" stroke-width="1.5" stroke-linejoin="round" stroke-linecap="round" />,
};
const look = (tone: string, shape: JSX.Element, ...states: string[]): void => {
  for (const state of states) kStateLook[state] = { tone, shape };
};
look("quiet", shapes.ring, "queued", "idle");
look("active", shapes.dot, "preparing", "finishing", "loading", "sending");
look("active", shapes.play, "running", "tracing");
look("held", shapes.bars, "paused", "draining", "drained", "disabled");
look("held", shapes.bang, "waiting");
look("good", shapes.check, "done");
look("bad", shapes.bang, "failed", "quarantined", "lost");
look("quiet", shapes.cross, "cancelled");

export function StateBadge({ state }: { state: JobState | string }) {
  const { tone, shape } = kStateLook[state] ?? { tone: "quiet", shape: shapes.ring };
  return (
    <span class={`badge tone-${tone}`}>
      <svg viewBox="0 0 12 12" width="12" height="12" aria-hidden="true">
        {shape}
      </svg>
      {state}
    </span>
  );
}

export function Progress({ job, label }: { job: Job; label: string }) {
  const share = progressOf(job);
  const tone = job.state === "done" ? "good" : job.state === "failed" ? "bad" : job.state === "cancelled" ? "quiet" : "active";
  const known = share ?? (job.passes_done > 0 ? undefined : 0);
  return (
    <div
      class={`progress tone-${tone}${known === undefined ? " endless" : ""}`}
      role="progressbar"
      aria-label={label}
      aria-valuemin={0}
      aria-valuemax={100}
      {...(known === undefined ? {} : { "aria-valuenow": Math.round(100 * known), "aria-valuetext": percent(known) })}
    >
      <div style={{ width: `${100 * (known ?? 1)}%` }} />
    </div>
  );
}

export function Empty({ title, children }: { title: string; children?: ComponentChildren }) {
  return (
    <div class="empty">
      <p class="empty-title">{title}</p>
      {children}
    </div>
  );
}

export function Notice({ tone, children, live }: { tone: "bad" | "held" | "info"; children: ComponentChildren; live?: boolean }) {
  return (
    <div class={`notice tone-${tone}`} {...(live ? { role: "alert" } : {})}>
      {children}
    </div>
  );
}

/** A titled region of a page. */
export function Panel({ title, aside, children, class: extra = "" }: { title: string; aside?: ComponentChildren; children: ComponentChildren; class?: string }) {
  const id = useId();
  return (
    <section class={`panel ${extra}`} aria-labelledby={id}>
      <header class="panel-head">
        <h2 id={id}>{title}</h2>
        {aside}
      </header>
      {children}
    </section>
  );
}

/** A modal question. Escape and the close button answer no. */
export function Dialog({ title, onClose, children }: { title: string; onClose: () => void; children: ComponentChildren }) {
  const element = useRef<HTMLDialogElement>(null);
  const id = useId();
  useEffect(() => {
    element.current?.showModal();
  }, []);
  return (
    <dialog
      ref={element}
      aria-labelledby={id}
      onClose={onClose}
      onClick={(event) => {
        if (event.target === element.current) onClose();
      }}
    >
      <div class="dialog-body">
        <h2 id={id}>{title}</h2>
        {children}
      </div>
    </dialog>
  );
}

/** The page's title: where focus goes after a change of page, so that it is read out. */
export function PageTitle({ text, children }: { text: string; children?: ComponentChildren }) {
  const heading = useRef<HTMLHeadingElement>(null);
  useEffect(() => {
    document.title = `${text} – photonfarm`;
  }, [text]);
  useEffect(() => {
    if (document.activeElement === document.body || document.activeElement?.closest("main, nav") !== null) {
      heading.current?.focus({ preventScroll: true });
    }
    window.scrollTo(0, 0);
  }, []);
  return (
    <div class="page-title">
      <h1 tabIndex={-1} ref={heading}>
        {text}
      </h1>
      {children}
    </div>
  );
}
