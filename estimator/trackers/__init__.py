"""What a tracker is: its contract, its declaration (`Spec`) and what several of them share. A folder a tracker."""
