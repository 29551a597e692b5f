// Numbers as the report writes them (number_text.py), and round lengths.
(function () {
  "use strict";
  const semsfm = (window.semsfm = window.semsfm || {});

  function fixed(value, digits) {
    return value.toFixed(Math.max(0, digits)).replace("-", "−");
  }

  semsfm.number = function (value, digits) {
    if (!Number.isFinite(value)) { return "–"; }
    if (Number.isInteger(value) && Math.abs(value) < 1e4) { return fixed(value, 0); }
    const size = Math.floor(Math.log10(Math.abs(value)));
    if (size < -4 || size > 8) { return value.toExponential(digits - 1).replace(/-/g, "−"); }
    return fixed(value, digits - 1 - size);
  };

  // to the digits of the standard deviation, two where it begins with 1 or 2
  semsfm.measured = function (value, sigma) {
    if (!(sigma > 0)) { return semsfm.number(value, 4); }
    const lead = Number(sigma.toExponential()[0]);
    const decimals = (lead < 3 ? 1 : 0) - Math.floor(Math.log10(sigma));
    return fixed(value, decimals) + " ± " + fixed(sigma, decimals);
  };

  // the largest of 1, 2, 5 times a power of ten that does not exceed a length
  semsfm.roundLength = function (length) {
    const power = Math.pow(10, Math.floor(Math.log10(length)));
    return [5, 2, 1].find((m) => m * power <= length * (1 + 1e-9)) * power;
  };

  semsfm.quantile = function (sorted, share) {
    return sorted[Math.round(share * (sorted.length - 1))];
  };
})();
