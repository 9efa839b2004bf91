// A text field with line numbers, one of which may be marked.
import { useRef } from "preact/hooks";

export function SpecEditor({ text, setText, badLine }: { text: string; setText: (text: string) => void; badLine: number }) {
  const gutter = useRef<HTMLDivElement>(null);
  const count = text.split("\n").length;
  return (
    <div class="editor">
      <div class="gutter" ref={gutter} aria-hidden="true">
        {Array.from({ length: count }, (_, i) => (
          <span key={i} class={i + 1 === badLine ? "bad" : ""}>
            {i + 1}
          </span>
        ))}
      </div>
      <textarea
        aria-label="Job file in TOML"
        aria-invalid={badLine > 0}
        spellcheck={false}
        autocapitalize="off"
        autoComplete="off"
        wrap="off"
        rows={26}
        value={text}
        onInput={(e) => setText(e.currentTarget.value)}
        onScroll={(e) => {
          if (gutter.current !== null) gutter.current.scrollTop = e.currentTarget.scrollTop;
        }}
      />
    </div>
  );
}
