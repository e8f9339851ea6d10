// Numbers to colours.

/** Viridis (Smith & van der Walt 2015) at equal steps, as in the pictures of `hemicube view`. */
export const VIRIDIS = [
  [68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140],
  [40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37],
];
/** Patches that have no number. */
export const NOTHING = [150, 150, 150];
/** The patch that was clicked. */
export const SELECTED = [214, 40, 40];

export function scaleColor(value) {
  const place = Math.min(Math.max(value, 0), 1) * (VIRIDIS.length - 1);
  const low = Math.min(Math.floor(place), VIRIDIS.length - 2);
  const share = place - low;
  return [0, 1, 2].map((c) => Math.round(VIRIDIS[low][c] + share * (VIRIDIS[low + 1][c] - VIRIDIS[low][c])));
}

export const GRADIENT = `linear-gradient(to right, ${VIRIDIS.map((c) => `rgb(${c})`).join(", ")})`;

/** A colour for an id, such that neighbours differ. */
export function idColor(id) {
  let x = Math.imul(id + 1, 0x9e3779b1);
  x = Math.imul(x ^ (x >>> 15), 0x85ebca6b);
  x ^= x >>> 13;
  return [60 + (x & 127) + ((x >>> 7) & 63), 60 + ((x >>> 10) & 127) + ((x >>> 17) & 63), 60 + ((x >>> 20) & 127) + ((x >>> 26) & 63)];
}

/** What of `values` lies at a share of those that are numbers. Sorted copies are made once an array. */
const sorted = new WeakMap();
export function quantile(values, share) {
  if (!sorted.has(values)) sorted.set(values, values.filter((value) => !Number.isNaN(value)).sort());
  const order = sorted.get(values);
  return order.length === 0 ? NaN : order[Math.min(order.length - 1, Math.floor(share * order.length))];
}

/** Linear light as it is shown (IEC 61966-2-1). */
function shown(linear) {
  const value = Math.min(Math.max(linear, 0), 1);
  return Math.round(255 * (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055));
}

/**
 * Light in three bands, tone-mapped as Reinhard et al. (2002) do: the average over the patches (their logarithms, unweighted)
 * becomes middle grey.
 */
export function lightColors(bands) {
  const count = bands[0].length;
  const luminance = (k) => 0.2126 * bands[0][k] + 0.7152 * bands[1][k] + 0.0722 * bands[2][k];
  let [logs, number, most] = [0, 0, 0];
  for (let k = 0; k < count; k++) {
    const level = luminance(k);
    if (level > 0) {
      logs += Math.log(level);
      number++;
      most = Math.max(most, level);
    }
  }
  const exposure = number > 0 ? 0.18 / Math.exp(logs / number) : 1;
  const white = Math.max(most * exposure, 1e-9);
  return (k) => {
    const level = luminance(k) * exposure;
    if (!(level > 0)) return Number.isNaN(level) ? NOTHING : [0, 0, 0];
    const factor = (exposure * (1 + level / white ** 2)) / (1 + level);
    return [0, 1, 2].map((band) => shown(Math.max(bands[band][k], 0) * factor));
  };
}
