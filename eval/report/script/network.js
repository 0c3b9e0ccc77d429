// A feed-forward network in float32, as the policy that was judged computes it.
class Network {
  constructor(carried, policy) {
    Object.assign(this, policy);
    this.layers = policy.layers.map(([outs, ins, weight, bias]) => ({ ins,
      weight: carried.floats(weight, outs * ins), bias: carried.floats(bias, outs),
      results: new Float32Array(outs) }));
    this.activate = policy.activation === "Tanh" ? Math.tanh : (x) => Math.max(x, 0);
  }

  outputs(observation) {
    let values = Float32Array.from(observation);
    if (this.statistics) {
      const { mean, var: spread, epsilon, clip } = this.statistics;
      values = values.map((x, k) =>
        Math.max(-clip, Math.min(clip, (x - mean[k]) / Math.sqrt(spread[k] + epsilon))));
    }
    this.layers.forEach(({ weight, bias, ins, results }, layer) => {
      const last = layer === this.layers.length - 1;
      for (let out = 0; out < bias.length; out += 1) {
        let sum = 0;
        for (let k = 0, at = out * ins; k < ins; k += 1, at += 1) sum += weight[at] * values[k];
        const before = Math.fround(Math.fround(sum) + bias[out]);
        results[out] = last ? before : this.activate(before);
      }
      values = results;
    });
    return values;
  }

  // Entries of the mean action, or the first of the largest outputs alone.
  action(observation) {
    const outputs = this.outputs(observation);
    if (!this.low) return [outputs.indexOf(Math.max(...outputs))];
    return Array.from(outputs, (output, k) => this.entry(output, this.low[k], this.high[k]));
  }

  entry(output, low, high) {
    if (!this.squash) return Math.max(low, Math.min(high, output));
    const limited = this.limit === null ? output : Math.max(-this.limit, Math.min(this.limit, output));
    // tanh, stretched to the bounds.
    const share = Math.fround(0.5 * Math.fround(Math.fround(Math.tanh(limited)) + 1));
    return Math.fround(low + Math.fround(share * Math.fround(high - low)));
  }
}
