"""Records made fit for identification, and what is wrong with them."""
