//! Accuracy of rows: from weights to form factors, and its cost.
//!
//! [`correct`] makes form factors of the weights of hemicubes, at an accuracy [level](crate::driver::level) chosen by
//! the user. A tolerance is kept by refining the visible fractions of some pairs (`refine`), by an error model
//! ([`error_model`]) with the parameters that [calibration](crate::driver::calibrate) found on a sample of the scene's
//! rows. Large patches get several hemicubes (`grain`). Rays measure the non-visible shares where a row's sum does not
//! tell them (`ray_shares`).
//!
//! Calibration draws rows by a seed and measures by rays how far visible fractions from one hemicube are off in this
//! scene: the *prior variances*, by the hemicube's fraction and by the pair's nearness; and how much such rays leave.
//! The multiplier λ that keeps the tolerance follows from these. Calibration does the rows once, and raises λ where they
//! expect more. Its result is part of the settings and hashed.
//!
//! `refine` does a row. Its pairs are the patches seen by the hemicube, and others found in the tree by bounds of F
//! (`candidates`). One multiplier λ between rays and squared error holds for the scene; calibration finds it from the
//! expected errors of its rows. Pairs whose prior variance is worth a shaft at λ are measured, the rest keep their
//! fraction. `shaft` lists the occluders between two triangles, as coplanar regions (`coplanar`): none, or one in front
//! of all, is proof. Otherwise rays are cast at those few, by segments or, near contact, by directions of a scrambled
//! Sobol sequence, in numbers by the spread of the rays so far. If that is dear, `exact` measures from points without
//! rays. Scenes of up to 400 patches have all pairs measured, and at 0.2 % or less each to the tolerance by itself; so
//! do scenes of up to 2,048 at 0.01 % or less, by cells cut along critical lines (`refine/exact`).
//!
//! A row is *inconsistent* if its hemicube loses a part that it should see. It is rendered again with 2 × 2 hemicubes
//! (`compute`); in a closed scene (`Refinement::is_open`), where hemicubes agree on their non-visible shares and the sum
//! is known, once more with 4 × 4 and strict correction.
//!
//! A row's work is bounded, in steps of about a nanosecond that are counted, never timed (`shaft`). A row of a
//! tolerance T has 10⁹ · 0.01 / T, at most 10¹¹. Pairs are then measured in the order of their expected
//! errors. A row that meets its bound is counted (`Summary::cut_short`), and its expected error holds the prior
//! variances of the rest. The last pair has what is left of the row's bound, so that no pair exceeds it: its rays stop
//! growing, its points' cells are divided no further, and the error is what they then have. A shaft of more than 256
//! triangles gives up its list, and its rays walk the tree of regions (`segments`): a ray costs the depth of the tree,
//! whatever lies in between.
//!
//! A patch much larger than the surfaces on it has n² hemicubes, stratified over it, n ≤ 16 and one for every 16 of
//! these surfaces (`grain`), unless pixels are summed. Every pair of its row is measured (`refine/large`), by the
//! row's own form factors: most of these surfaces are nearer to the patch than its hemicubes to each other. The row's
//! form factors are small; the larger one of each pair is in the other row.
//!
//! Non-visible shares are refined with the row (`store::shares`): by the residual of its sum, or, with backs or
//! unselected patches in view, by 256 to 131,072 rays from all over the patch (`ray_shares`). These rays also find rows
//! of centroids in a solid, which get up to sixteen hemicubes, and patches in view that a row lacks.

pub(crate) mod caster;
pub(crate) mod closing;
pub mod correct;
pub mod error_model;
pub mod fit;
pub(crate) mod grain;
pub(crate) mod ladder;
pub(crate) mod ray_shares;
pub(crate) mod refine;
pub(crate) mod row;
pub(crate) mod spread;
