import type { XAxis } from "./x-axis";

/** Curve of a chart. */
export interface Curve {
  label: string;
  /** CSS custom property, --c0 to --c5. */
  colour: string;
  values: (number | null)[];
  /** Lower and upper bound around the values. */
  low?: (number | null)[];
  high?: (number | null)[];
  /** Meaning of these bounds, for the legend. */
  bounds?: string;
  /** True for dashes, or the lengths of dashes and gaps in pixels. */
  dashed?: boolean | number[];
  /** True if the value is constant between points: drawn as steps. */
  stepped?: boolean;
  /** Values before they were scaled for the drawing, for the legend and the CSV file. */
  source?: CurveSource;
}

/** Values of a curve in their own unit. */
export interface CurveSource {
  values: (number | null)[];
  low?: (number | null)[];
  high?: (number | null)[];
  /** Formats a value with its unit. */
  format: (value: number) => string;
}

/** Labelled position on a chart, for example of a level move. */
export interface Marker {
  /** Position on the horizontal axis. */
  at: number;
  label: string;
  kind: "up" | "down" | "other";
}

/** Formats curves as comma-separated values; `x` has the positions on the axis: seconds since 1970, or others. */
export function csv(x: number[], curves: Curve[], xAxis: XAxis = "time"): string {
  const quoted = (text: string) => `"${text.replaceAll('"', '""')}"`;
  const columns = curves.flatMap((curve) => {
    const { values, low, high } = curve.source ?? curve;
    return [
      { name: curve.label, values },
      ...(low && high
        ? [
            { name: `${curve.label}, low`, values: low },
            { name: `${curve.label}, high`, values: high },
          ]
        : []),
    ];
  });
  const head = [xAxis, ...columns.map((column) => quoted(column.name))].join(",");
  const position = (at: number) => (xAxis === "time" ? new Date(1000 * at).toISOString() : at);
  const rows = x.map((at, i) => [position(at), ...columns.map((column) => column.values[i] ?? "")].join(","));
  return [head, ...rows, ""].join("\n");
}

/** Offers a text file as a download. */
export function download(name: string, kind: string, text: string) {
  const url = URL.createObjectURL(new Blob([text], { type: kind }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  URL.revokeObjectURL(url);
}
