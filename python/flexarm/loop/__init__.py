"""Control loops: poles, margins, root loci, and limits of stability."""
