"""The chips: registers, codes and timing, without any input or output."""
