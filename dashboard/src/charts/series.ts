/** What a chart shows. */
export interface Curve {
  label: string;
  /** One of the CSS custom properties: --c0 to --c5. */
  colour: string;
  values: (number | null)[];
  /** An interval around the values. */
  low?: (number | null)[];
  high?: (number | null)[];
  dashed?: boolean;
  /** It stays as it is until it changes: drawn in steps. */
  stepped?: boolean;
}

/** A moment with words: a level that moved. */
export interface Mark {
  at: number;
  words: string;
  kind: "up" | "down" | "other";
}

/** The same as comma-separated values, for who computes on. */
export function csv(x: number[], curves: Curve[]): string {
  const quoted = (text: string) => `"${text.replaceAll('"', '""')}"`;
  const columns = curves.flatMap((curve) => [
    { name: curve.label, values: curve.values },
    ...(curve.low && curve.high
      ? [
          { name: `${curve.label}, low`, values: curve.low },
          { name: `${curve.label}, high`, values: curve.high },
        ]
      : []),
  ]);
  const head = ["time", ...columns.map((column) => quoted(column.name))].join(",");
  const rows = x.map((at, i) =>
    [new Date(1000 * at).toISOString(), ...columns.map((column) => column.values[i] ?? "")].join(","),
  );
  return [head, ...rows, ""].join("\n");
}

/** Gives a file to whoever looks. */
export function download(name: string, kind: string, text: string) {
  const url = URL.createObjectURL(new Blob([text], { type: kind }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  URL.revokeObjectURL(url);
}
