"""What is below `inside` runs in the machine only."""

import os

collect_ignore = [] if "CONTEXTPOLICY_NODE_CGROUP_DRIVER" in os.environ else ["inside"]
