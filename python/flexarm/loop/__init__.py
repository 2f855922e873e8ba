"""Control loops: poles, margins, root loci, and what makes them unstable."""
