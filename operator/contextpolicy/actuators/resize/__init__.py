"""Pod resize (KEP-1287): what a plan wants of each pod's containers becomes patches of `pods/resize`."""
