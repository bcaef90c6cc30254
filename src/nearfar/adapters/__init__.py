"""nearfar under the calling conventions of other packages, none of which is needed here."""
