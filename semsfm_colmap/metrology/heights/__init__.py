"""Heights on a grid: levelling, filters, areal and profile parameters, two surfaces compared."""
