"""The paper's figures and tables, computed anew."""
