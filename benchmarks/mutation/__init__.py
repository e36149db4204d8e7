"""Parts of the mutation testing: which mutants a file has, and how one is tested."""
