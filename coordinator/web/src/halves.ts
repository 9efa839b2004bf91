// Half floats (IEEE 754 binary16). There are only 65536 of them: what is drawn of each value is looked up in a table.

export const kHalves = 65536;

function decode(bits: number): number {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction === 0 ? sign * Infinity : NaN;
  return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}

export const halfValues: Float32Array = Float32Array.from({ length: kHalves }, (_, bits) => decode(bits));
