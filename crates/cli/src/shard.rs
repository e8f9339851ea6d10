//! The shard of this process, from the environment set by its scheduler.
//!
//! | scheduler | number | of | counted from |
//! |---|---|---|---|
//! | Slurm's array jobs | `SLURM_ARRAY_TASK_ID` | `SLURM_ARRAY_TASK_COUNT` | `SLURM_ARRAY_TASK_MIN` |
//! | Kubernetes' indexed jobs | `JOB_COMPLETION_INDEX` | `--shard auto/N` | 0 |
//! | Open MPI | `OMPI_COMM_WORLD_RANK` | `OMPI_COMM_WORLD_SIZE` | 0 |
//! | PMI (MPICH, Intel MPI, Slurm with PMI) | `PMI_RANK` | `PMI_SIZE` | 0 |
//! | Slurm's `srun` | `SLURM_PROCID` | `SLURM_STEP_NUM_TASKS` or `SLURM_NTASKS` | 0 |
//!
//! Array jobs are numbered in steps of `SLURM_ARRAY_TASK_STEP`. The first two rows number jobs, the others the
//! processes of a job. If both are set, each job's share is divided among its processes.
//!
//! No shard without `--shard auto`, because an allocation's variables are also set for a program started in it by hand,
//! once, to compute everything.

use crate::args::ShardChoice;
use crate::exit::hinted;
use anyhow::{Result, anyhow};
use hemicube::store::Shard;

/// A share named by the environment.
struct Found {
    index: u64,
    count: u64,
    /// `SLURM_PROCID=3 of SLURM_NTASKS=16`.
    said: String,
}

/// The shard of this process, and the variables that name it, if the user did not.
///
/// # Errors
/// When a scheduler's variables are missing or contradict themselves.
pub(crate) fn shard(choice: ShardChoice, variable: &dyn Fn(&str) -> Option<String>) -> Result<(Shard, Option<String>)> {
    let given = match choice {
        ShardChoice::Given(shard) => return Ok((shard, None)),
        ShardChoice::Auto(count) => count.map(u64::from),
    };
    let outer = match array(variable)? {
        Some(found) => Some(found),
        None => kubernetes(variable, given)?,
    };
    let mut inner = None;
    for (rank, sizes) in [
        ("OMPI_COMM_WORLD_RANK", &["OMPI_COMM_WORLD_SIZE"][..]),
        ("PMI_RANK", &["PMI_SIZE"]),
        ("SLURM_PROCID", &["SLURM_STEP_NUM_TASKS", "SLURM_NTASKS"]),
    ] {
        if let Some(found) = process(variable, rank, sizes)? {
            inner = Some(found);
            break;
        }
    }
    let (index, count, said) = match (outer, inner) {
        // A batch script's single task adds nothing to its array.
        (Some(outer), Some(inner)) if inner.count > 1 => (
            outer.index * inner.count + inner.index,
            outer.count * inner.count,
            format!("{} and {}", outer.said, inner.said),
        ),
        (Some(found), _) | (None, Some(found)) => (found.index, found.count, found.said),
        (None, None) => {
            return Err(hinted(
                anyhow!(
                    "`--shard auto`: no scheduler says which shard this is; looked for SLURM_ARRAY_TASK_ID, \
                     JOB_COMPLETION_INDEX, OMPI_COMM_WORLD_RANK, PMI_RANK and SLURM_PROCID"
                ),
                "name it: `--shard 3/16`",
            ));
        }
    };
    if let Some(given) = given
        && given != count
    {
        return Err(anyhow!("`--shard auto/{given}`, but {said} makes {count} shards"));
    }
    let shard = u32::try_from(index)
        .ok()
        .zip(u32::try_from(count).ok())
        .and_then(|(index, count)| Shard::new(index, count));
    shard
        .map(|shard| (shard, Some(said.clone())))
        .ok_or_else(|| anyhow!("`--shard auto`: {said} is no shard"))
}

fn number(variable: &dyn Fn(&str) -> Option<String>, name: &str) -> Result<Option<u64>> {
    match variable(name).filter(|text| !text.is_empty()) {
        None => Ok(None),
        Some(text) => match text.parse() {
            Ok(number) => Ok(Some(number)),
            Err(_) => Err(anyhow!("`--shard auto`: {name} is `{text}`, which is no number")),
        },
    }
}

fn array(variable: &dyn Fn(&str) -> Option<String>) -> Result<Option<Found>> {
    let Some(id) = number(variable, "SLURM_ARRAY_TASK_ID")? else {
        return Ok(None);
    };
    let Some(count) = number(variable, "SLURM_ARRAY_TASK_COUNT")? else {
        return Err(anyhow!(
            "`--shard auto`: SLURM_ARRAY_TASK_ID is set and SLURM_ARRAY_TASK_COUNT is not"
        ));
    };
    let first = number(variable, "SLURM_ARRAY_TASK_MIN")?.unwrap_or(0);
    let step = number(variable, "SLURM_ARRAY_TASK_STEP")?.unwrap_or(1).max(1);
    let said = format!("SLURM_ARRAY_TASK_ID={id} of SLURM_ARRAY_TASK_COUNT={count}");
    let index = id.checked_sub(first).filter(|from_first| from_first % step == 0);
    match index.map(|from_first| from_first / step) {
        Some(index) if index < count => Ok(Some(Found { index, count, said })),
        // With `--array=1,5,7`, no variable ranks the three.
        _ => Err(hinted(
            anyhow!("`--shard auto`: {said}, from SLURM_ARRAY_TASK_MIN={first} in steps of {step}, is no shard"),
            "number the array's tasks without gaps: `--array=0-15`",
        )),
    }
}

fn kubernetes(variable: &dyn Fn(&str) -> Option<String>, count: Option<u64>) -> Result<Option<Found>> {
    let Some(index) = number(variable, "JOB_COMPLETION_INDEX")? else {
        return Ok(None);
    };
    let Some(count) = count else {
        return Err(hinted(
            anyhow!("`--shard auto`: JOB_COMPLETION_INDEX={index} does not say of how many"),
            "`--shard auto/N`, with the job's `completions` as N",
        ));
    };
    Ok(Some(Found {
        index,
        count,
        said: format!("JOB_COMPLETION_INDEX={index} of {count}"),
    }))
}

fn process(variable: &dyn Fn(&str) -> Option<String>, rank: &str, sizes: &[&str]) -> Result<Option<Found>> {
    let Some(index) = number(variable, rank)? else {
        return Ok(None);
    };
    for size in sizes {
        if let Some(count) = number(variable, size)? {
            return Ok(Some(Found {
                index,
                count,
                said: format!("{rank}={index} of {size}={count}"),
            }));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The choice, the environment, and the part of the result or error.
    type Case<'a> = (&'a str, &'a [(&'a str, &'a str)], &'a str);

    fn of(choice: &str, variables: &[(&str, &str)]) -> Result<String> {
        let variable = |name: &str| {
            let found = variables.iter().find(|(other, _)| *other == name);
            found.map(|(_, value)| (*value).to_owned())
        };
        let choice = choice.parse().map_err(|error: String| anyhow!(error))?;
        shard(choice, &variable).map(|(shard, _)| shard.to_string())
    }

    #[test]
    fn each_scheduler_is_understood() {
        let cases: [Case<'_>; 9] = [
            ("3/16", &[("SLURM_PROCID", "1"), ("SLURM_NTASKS", "4")], "3/16"),
            (
                "auto",
                &[
                    ("SLURM_ARRAY_TASK_ID", "7"),
                    ("SLURM_ARRAY_TASK_COUNT", "4"),
                    ("SLURM_ARRAY_TASK_MIN", "1"),
                    ("SLURM_ARRAY_TASK_STEP", "2"),
                    ("SLURM_PROCID", "0"),
                    ("SLURM_NTASKS", "1"),
                ],
                "4/4",
            ),
            ("auto", &[("SLURM_PROCID", "0"), ("SLURM_NTASKS", "4")], "1/4"),
            (
                "auto",
                &[
                    ("OMPI_COMM_WORLD_RANK", "3"),
                    ("OMPI_COMM_WORLD_SIZE", "4"),
                    ("SLURM_PROCID", "0"),
                    ("SLURM_NTASKS", "4"),
                ],
                "4/4",
            ),
            ("auto", &[("PMI_RANK", "1"), ("PMI_SIZE", "2")], "2/2"),
            ("auto/8", &[("JOB_COMPLETION_INDEX", "5")], "6/8"),
            (
                "auto",
                &[
                    ("SLURM_PROCID", "2"),
                    ("SLURM_STEP_NUM_TASKS", "3"),
                    ("SLURM_NTASKS", "8"),
                ],
                "3/3",
            ),
            // Two jobs of three processes each.
            (
                "auto",
                &[
                    ("SLURM_ARRAY_TASK_ID", "1"),
                    ("SLURM_ARRAY_TASK_COUNT", "2"),
                    ("SLURM_ARRAY_TASK_MIN", "0"),
                    ("SLURM_PROCID", "2"),
                    ("SLURM_STEP_NUM_TASKS", "3"),
                ],
                "6/6",
            ),
            ("auto/4", &[("PMI_RANK", "1"), ("PMI_SIZE", "4")], "2/4"),
        ];
        for (choice, variables, wanted) in cases {
            assert_eq!(of(choice, variables).unwrap(), wanted, "{variables:?}");
        }
    }

    #[test]
    fn what_is_not_said_is_not_guessed() {
        let cases: [Case<'_>; 8] = [
            ("auto", &[], "no scheduler says"),
            ("auto", &[("JOB_COMPLETION_INDEX", "5")], "of how many"),
            ("auto/4", &[("JOB_COMPLETION_INDEX", "4")], "is no shard"),
            ("auto/3", &[("PMI_RANK", "1"), ("PMI_SIZE", "4")], "makes 4"),
            ("auto", &[("PMI_RANK", "x"), ("PMI_SIZE", "4")], "no number"),
            ("auto", &[("SLURM_ARRAY_TASK_ID", "3")], "SLURM_ARRAY_TASK_COUNT"),
            (
                "auto",
                &[
                    ("SLURM_ARRAY_TASK_ID", "7"),
                    ("SLURM_ARRAY_TASK_COUNT", "3"),
                    ("SLURM_ARRAY_TASK_MIN", "1"),
                ],
                "is no shard",
            ),
            ("auto/x", &[], "`auto/16`"),
        ];
        for (choice, variables, wanted) in cases {
            let error = of(choice, variables).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }
}
