//! Recipes and scenarios. Tables `recipes` and `scenarios`.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use env_core::{Recipe, Scenario, Seed};
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{MAX_ROWS, StoreError, hex_list, to_i64, to_json, to_u64};

/// Stores recipes. Recipes that are stored already stay as they are.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert_recipes(conn: &mut SqliteConnection, recipes: &[&Recipe]) -> Result<(), StoreError> {
    let rows = recipes.iter().map(|recipe| Ok((recipe.id().0, to_json(&recipe.to_json())?)));
    // Scenarios of one batch often share a recipe.
    let rows = rows.collect::<Result<BTreeMap<_, _>, StoreError>>()?;
    for rows in rows.iter().collect::<Vec<_>>().chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO recipes (id, body) ");
        statement.push_values(rows, |mut values, (id, body)| {
            values.push_bind(id.as_slice()).push_bind(body);
        });
        statement.push(" ON CONFLICT (id) DO NOTHING").build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Stores scenarios and their recipes. Those that are stored already stay as they are.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert(conn: &mut SqliteConnection, scenarios: &[&Scenario]) -> Result<(), StoreError> {
    let recipes: Vec<&Recipe> = scenarios.iter().map(|scenario| &**scenario.recipe()).collect();
    insert_recipes(conn, &recipes).await?;
    for rows in scenarios.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO scenarios (id, recipe, seed) ");
        statement.push_values(rows, |mut values, scenario| {
            values.push_bind(scenario.id().0.to_vec()).push_bind(scenario.recipe().id().0.to_vec());
            values.push_bind(to_i64(scenario.seed().get()));
        });
        statement.push(" ON CONFLICT (id) DO NOTHING").build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the seed of a scenario.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn seed(conn: &mut SqliteConnection, id: &[u8]) -> Result<Option<u64>, StoreError> {
    let seed =
        sqlx::query_scalar!("SELECT seed FROM scenarios WHERE id = ?", id).fetch_optional(conn).await?;
    Ok(seed.map(to_u64))
}

/// Reads scenarios, and parses each recipe once.
#[derive(Debug, Default)]
pub struct ScenarioLoader {
    recipes: HashMap<Vec<u8>, Arc<Recipe>>,
}

/// Scenarios that were read together. A scenario that cannot be decoded is an error of its own entry.
#[derive(Debug, Default)]
pub struct LoadedScenarios(HashMap<Vec<u8>, Result<Scenario, StoreError>>);

impl LoadedScenarios {
    /// Finds a scenario by its id.
    ///
    /// # Errors
    /// Returns [`StoreError::Corrupt`] if the scenario does not exist or cannot be decoded.
    pub fn get(&self, id: &[u8]) -> Result<&Scenario, StoreError> {
        match self.0.get(id) {
            Some(Ok(scenario)) => Ok(scenario),
            Some(Err(error)) => Err(StoreError::corrupt("a scenario", error)),
            None => Err(missing("a scenario")),
        }
    }
}

fn missing(item: &'static str) -> StoreError {
    StoreError::corrupt(item, "it is gone")
}

impl ScenarioLoader {
    /// Reads a scenario by its id.
    ///
    /// # Errors
    /// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if the scenario does not exist or cannot
    /// be decoded.
    pub async fn get(&mut self, conn: &mut SqliteConnection, id: &[u8]) -> Result<Scenario, StoreError> {
        self.all(conn, &[id]).await?.get(id).cloned()
    }

    /// Reads scenarios by their ids, in one statement.
    ///
    /// # Errors
    /// Returns [`StoreError::Database`] if the query fails.
    pub async fn all<T: AsRef<[u8]>>(
        &mut self,
        conn: &mut SqliteConnection,
        ids: &[T],
    ) -> Result<LoadedScenarios, StoreError> {
        let ids = hex_list(ids)?;
        let rows = query!(
            r#"SELECT id AS "id!: Vec<u8>", seed AS "seed?: i64", recipe AS "recipe?: Vec<u8>", NULL AS "body?: String"
               FROM scenarios WHERE id IN (SELECT unhex(value) FROM json_each(?1))
               UNION ALL
               SELECT id, NULL, NULL, body FROM recipes WHERE id IN (
                   SELECT recipe FROM scenarios WHERE id IN (SELECT unhex(value) FROM json_each(?1)))"#,
            ids
        )
        .fetch_all(&mut *conn)
        .await?;
        let (mut scenarios, mut bodies) = (Vec::new(), HashMap::new());
        for row in rows {
            match (row.seed, row.recipe, row.body) {
                (Some(seed), Some(recipe), _) => scenarios.push((row.id, seed, recipe)),
                (.., Some(body)) => drop(bodies.insert(row.id, body)),
                _ => {}
            }
        }
        let loaded = scenarios.into_iter().map(|(id, seed, recipe)| {
            let recipe = self.parse_once(&recipe, bodies.get(&recipe));
            (id, recipe.and_then(|recipe| Ok(Scenario::new(recipe, Seed::new(to_u64(seed))?))))
        });
        Ok(LoadedScenarios(loaded.collect()))
    }

    /// Reads a recipe by its id.
    ///
    /// # Errors
    /// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if the recipe does not exist or cannot be
    /// decoded.
    pub async fn recipe(
        &mut self,
        conn: &mut SqliteConnection,
        id: &[u8],
    ) -> Result<Arc<Recipe>, StoreError> {
        if let Some(recipe) = self.recipes.get(id) {
            return Ok(Arc::clone(recipe));
        }
        let body =
            sqlx::query_scalar!("SELECT body FROM recipes WHERE id = ?", id).fetch_optional(conn).await?;
        self.parse_once(id, body.as_ref())
    }

    /// Parses the body of a recipe, unless the recipe is known.
    fn parse_once(&mut self, id: &[u8], body: Option<&String>) -> Result<Arc<Recipe>, StoreError> {
        if let Some(recipe) = self.recipes.get(id) {
            return Ok(Arc::clone(recipe));
        }
        let body = body.ok_or_else(|| missing("a recipe"))?;
        let value: serde_json::Value = super::from_json("a recipe", body)?;
        let recipe = Arc::new(Recipe::from_json(&value)?);
        self.recipes.insert(id.to_owned(), Arc::clone(&recipe));
        Ok(recipe)
    }
}
