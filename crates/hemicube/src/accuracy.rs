//! How right a row is: from weights to form factors, and what that costs.
//!
//! [`correct`] makes form factors of the weights of hemicubes, at an accuracy [level](crate::driver::level) that the
//! user chose. A tolerance is kept by refining the visible fractions of some pairs (`refine`), with what
//! [calibration](crate::driver::calibrate) learnt from a sample of the scene's rows. Large patches get several hemicubes (`grain`), and what a row loses is measured by rays
//! where its sum does not say (`lost`).
//!
//! `settle.rs` draws rows by a seed, learns from rays how far visible fractions from one hemicube are off in this scene
//! (the *prior variances*, by what the hemicube says and how near the pair is), and takes the cheapest effort whose
//! rows, held against the same rows with a quarter of it, keep the tolerance with a margin. What it found is part of
//! the settings and hashed.
//!
//! `refine.rs` does a row: pairs are what the hemicube saw and what `candidates.rs` finds in the tree by bounds of F,
//! seen or not. A unit of squared error has one price in rays all over the scene, which settling finds from a census of
//! the rows it tries; pairs whose prior variance is worth a shaft at that price are measured, the rest kept. `shaft.rs`
//! lists what may come in between two triangles, as the walls (`walls.rs`) that the scene's surfaces make up where they
//! are of one plane and convex together: nothing, or one wall in front of all, is proof; otherwise rays at those few,
//! by segments or, near contact, by directions, of a scrambled Sobol sequence, as many as the rays so far ask for;
//! where that is dear, `clip.rs` measures from points without rays. Scenes of up to 400 patches have all pairs
//! measured, and at 0.2 % or less each to the tolerance by itself.
//!
//! The area rung, where no tolerance is asked for, does the same for a few pairs (`Refiner::mend`): no sample is held
//! against rays, prior variances are those that rooms and cities were found to have, and a pair is worth a shaft if its
//! prior variance is a share of its row. Those are mostly patches that all but touch. A row whose hemicube loses what
//! it should see, or of which rays find much more than its hemicube did, gets four hemicubes instead (`compute.rs`):
//! rays mend what is large, not a street of small patches. So does an odd row of a tolerance; only where the scene is
//! closed (`Refinement::open`, from the rows that are settled with) and the hemicubes agree on what they lost is its
//! sum a fact, and then it is done with sixteen and with care.
//!
//! What a row may cost is bounded, in steps of about a nanosecond that are counted, never timed (`shaft.rs`): mending
//! has 400,000 + 1,000 an entry for a row of one hemicube, times max(n, n²/4) for one of n² hemicubes; a row of a
//! tolerance T has 10⁹ · max(0.01 / T, 1), at most 10¹¹. Pairs are then measured in the order of what they are worth. A
//! row that meets its bound is counted (`Summary::cut_short`), and its expected error holds the prior variances of what
//! was left. A shaft that lists more than 256 triangles gives up its list, and its rays walk the tree of walls
//! (`segments.rs`): a ray costs the depth of the tree, whatever lies in between. A patch that is much larger than what
//! stands on it has n² hemicubes, stratified over it, n ≤ 16 and one for every 16 surfaces that stand on it
//! (`grain.rs`), on all rungs but pixel sums. Of its row every pair is measured (`refine/large.rs`), as most of what
//! stands on it is nearer to it than its hemicubes are to each other; by the row's own form factors, which are small:
//! the larger one of each pair is in the other row.
//!
//! What a row loses is refined with it (`shares.rs`): by the residual of its sum, and where backs or unselected patches
//! have a part in that, by rays from all over the patch (`lost.rs`, 256 to 16,384 of them), which also find the rows
//! whose centroids lie in a solid: those get up to sixteen hemicubes.

pub mod correct;
pub mod error_model;
pub(crate) mod grain;
pub(crate) mod ray_shares;
pub(crate) mod refine;
pub(crate) mod row;
