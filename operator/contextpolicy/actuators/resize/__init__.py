"""Pod resize (KEP-1287): turns what a plan wants of each pod's containers into patches of `pods/resize`."""
