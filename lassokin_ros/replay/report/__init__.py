"""`replay --report`: one page that shows what became of a recording."""
